"""Equilibrium at the end of a step: Newton's method with a line search."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np

from meshes.arrays import FloatArray
from solver_adapters.bundled.fem.problem import Problem
from solver_adapters.bundled.fem.state import Increment, Instant
from solver_adapters.bundled.law.law import P_C11
from solver_adapters.bundled.linear.residual_check import LinearSolverError
from solver_adapters.bundled.linear.split_matrix import RESIDUAL
from solver_adapters.bundled.statistics import Statistics
from solver_adapters.bundled.tangent_system import TangentSystem

MOST_NEWTON = 14
# A residual this far below the reaction is rounding, whatever tolerance was asked for.
ROUNDING = 1e-12
# Strain that rounding leaves behind: of its force nothing better can be asked.
ROUNDED_STRAIN = 1e-15
# Beyond so many times its length a step says little of another one.
_MOST_SCALED = 4.0
# Accuracy with which each linear system of the Newton iteration is solved at least: with 0.1 a step
# that begins far from equilibrium takes up to a third more iterations, and with 0.01 a slip of 1e-9
# of a step may go unseen.
ROUGH = 1e-3
# What Newton's method leaves of a residual as large as the reaction (benchmarks/numerics.md).
LEFT = 0.3
_EMPTY = np.empty((0, 9, 9))


@dataclass(frozen=True, eq=False)
class Trial:
    """Points and forces at a trial displacement.

    Attributes:
        moves: whether the boundary moves in the step, or holds.
        u: displacement [µm], (n_nodes, 3).
        H: displacement gradients times the crystal rotations, (n_points, 9).
        state: states of the points, (n_points, n_state); empty where a line search starts.
        slips: slips of the step, (n_points, n_systems).
        P: first Piola–Kirchhoff stress times the crystal rotations [MPa], (n_points, 9).
        C: tangents ∂P/∂H, (n_points, 9, 9); empty where a line search starts.
        forces: nodal forces [µN], (3·n_nodes,).
        local_failure: the point whose law found no solution, or None.
    """

    moves: bool
    u: FloatArray
    H: FloatArray
    state: FloatArray
    slips: FloatArray
    P: FloatArray
    C: FloatArray
    forces: FloatArray
    local_failure: int | None

    def without_tangents(self) -> Trial:
        """Return it without tangents and states, the largest of its arrays."""
        return replace(self, state=_EMPTY, C=_EMPTY)


class NotConvergedError(Exception):
    """The step has to be cut; the message says what failed where."""


class Equilibrium:
    """Solves the steps of one problem, one after the other."""

    def __init__(self, problem: Problem, tolerance: float, statistics: Statistics) -> None:
        self.problem = problem
        self.tolerance = tolerance
        self.statistics = statistics
        self._least = _rounded_force(problem)
        self._system = TangentSystem(problem, statistics)

    def _evaluate(
        self, instant: Instant, u: FloatArray, guess: FloatArray, dt: float, moves: bool
    ) -> Trial:
        p, clock = self.problem, time.perf_counter()
        H = p.strain(u)
        found = p.points.update(H, instant.state, guess, dt, instant.H)
        clock = self.statistics.clock("points", clock)
        total = p.forces(found.P)
        self.statistics.clock("assembly", clock)
        worst = int(np.argmin(found.iterations))
        failed = worst if found.iterations[worst] < 0 else None
        return Trial(moves, u, H, found.state, found.slips, found.P, found.C, total, failed)

    def assemble(self, trial: Trial, columns: int = 0) -> None:
        """Take the tangent of a trial; `columns` as in `TangentSystem.assemble`."""
        try:
            self._system.assemble(trial.C, trial.moves, columns)
        except LinearSolverError as error:
            raise NotConvergedError(self._where(trial, str(error))) from None

    def solve(self, trial: Trial, rhs: FloatArray, accuracy: float = RESIDUAL) -> FloatArray:
        """Solve with the tangent of a trial."""
        try:
            return self._system.solve(rhs, accuracy)
        except LinearSolverError as error:
            raise NotConvergedError(self._where(trial, str(error))) from None

    def _predict(
        self,
        instant: Instant,
        motion: FloatArray,
        dt: float,
        last: dict[bool, Increment],
        near: FloatArray | None,
    ) -> Trial:
        """Start of a step: the last of its kind scaled, or one tangent step.

        Where a nearby simulation is known, only what the last step differed by from that one is
        scaled; without a last one, the nearby step itself.
        """
        p = self.problem
        moved = motion - instant.u.ravel()[p.prescribed]
        moves = bool(np.any(moved))
        alike = last.get(moves)
        slips = rest = np.zeros((p.points.grain.size, p.points.n_systems))
        ratio = 0.0
        if alike is not None:
            ratio = _ratio(moved, alike.motion) if moves else dt / alike.dt
        du = None
        if alike is not None and 0.0 < ratio < _MOST_SCALED:
            slips = ratio * alike.slips
            du = ratio * alike.du if near is None else near + ratio * (alike.du - alike.near)
        elif near is not None:
            share = _ratio(moved, near.ravel()[p.prescribed]) if moves else 1.0
            du = share * near if 0.0 < share < _MOST_SCALED else None
        if du is not None:
            u = instant.u + du
            u.ravel()[p.prescribed] = motion
            return self._evaluate(instant, u, slips, dt, moves)
        trial = self._evaluate(instant, instant.u, rest, dt, moves)
        self.assemble(trial)
        lifted = np.zeros((p.n_nodes, 3))
        lifted.ravel()[p.prescribed] = moved
        residual = trial.forces + p.forces(np.einsum("pij,pj->pi", trial.C, p.strain(lifted)))
        lifted.ravel()[p.pattern.free] = self.solve(trial, -residual[p.pattern.free])
        return self._evaluate(instant, instant.u + lifted, rest, dt, moves)

    def solve_step(
        self,
        instant: Instant,
        motion: FloatArray,
        dt: float,
        last: dict[bool, Increment],
        near: FloatArray | None = None,
    ) -> Trial:
        """Solve a step by Newton's method.

        Args:
            instant: the start of the step.
            motion: the prescribed motion at its end [µm], (n_prescribed,).
            dt: its length [s].
            last: increments to start from, by whether the boundary moved.
            near: the displacement increment of a nearby simulation over the step [µm],
                (n_nodes, 3), to start from where it is known.

        Raises:
            NotConvergedError: it has to be cut.
        """
        if near is not None:
            try:
                return self._iterate(instant, self._predict(instant, motion, dt, last, near), dt)
            except NotConvergedError:
                pass  # It went too far from here: no step is cut for that.
        return self._iterate(instant, self._predict(instant, motion, dt, last, None), dt)

    def _iterate(self, instant: Instant, trial: Trial, dt: float) -> Trial:
        """Newton iterations from a trial to the end of its step, each with a line search.

        Raises:
            NotConvergedError: they do not end there.
        """
        free, prescribed = self.problem.pattern.free, self.problem.prescribed
        norm = _norm(trial.forces[free])
        for _ in range(MOST_NEWTON):
            reaction = _norm(trial.forces[prescribed])
            target = max(max(self.tolerance, ROUNDING) * reaction, self._least)
            if norm <= target and trial.local_failure is None:
                return trial
            self.assemble(trial)
            trial = trial.without_tangents()  # The matrix holds them.
            accuracy = _accuracy(norm, target, reaction)
            step = self.solve(trial, -trial.forces[free], accuracy)
            self.statistics.iterations += 1
            trial, norm = self._line_search(instant, trial, step, norm, dt)
        raise NotConvergedError(self._where(trial, _stalled(norm)))

    def _line_search(
        self, instant: Instant, trial: Trial, step: FloatArray, norm: float, dt: float
    ) -> tuple[Trial, float]:
        """Halve the step while the residual grows; the best of four, even if it grew in all."""
        free = self.problem.pattern.free
        best, length = None, 1.0
        for _ in range(4):
            u = trial.u.copy()
            u.ravel()[free] += length * step
            candidate = self._evaluate(instant, u, trial.slips, dt, trial.moves)
            new = _norm(candidate.forces[free])
            usable = np.isfinite(new) and candidate.local_failure is None
            if usable and (best is None or new < best[1]):
                best = (candidate, new)
            if usable and new <= norm:
                break
            length *= 0.5
        if best is None:
            raise NotConvergedError(self._where(candidate, _stalled(new)))
        return best

    def _where(self, trial: Trial, what: str) -> str:
        """Complete a message with the element that fails, or that is furthest from equilibrium."""
        p = self.problem
        if trial.local_failure is not None:
            cell = trial.local_failure // p.weights.shape[1]
            what = "the crystal law did not converge"
        else:
            force = np.zeros(3 * p.n_nodes)
            force[p.pattern.free] = trial.forces[p.pattern.free]
            node = int(np.argmax(np.linalg.norm(force.reshape(-1, 3), axis=1)))
            cell = int(np.flatnonzero((p.cells == node).any(axis=1))[0])
        grain = int(p.points.grain[p.weights.shape[1] * cell]) + 1
        return f"{what} (element {cell}, grain {grain})"


def _accuracy(norm: float, target: float, reaction: float) -> float:
    """Largest ‖b − A x‖ / ‖b‖ of a linear system of the iteration.

    Newton's method leaves LEFT norm² / reaction of a residual. A better solution is of no use
    (Dembo, Eisenstat and Steihaug, SIAM J. Numer. Anal. 19 (1982) 400). The last iteration leaves
    a tenth of the target. At the target only a point without a solution asks for an iteration.

    Args:
        norm: of the residual [µN].
        target: norm at which the iteration ends [µN].
        reaction: norm of the prescribed forces, 0 for none [µN].
    """
    if norm <= target:
        return ROUGH
    left = LEFT * norm / max(reaction, norm)
    if left * norm <= target:
        left = 0.1 * target / norm
    return min(ROUGH, left)


def _ratio(moved: FloatArray, before: FloatArray) -> float:
    """By how much one motion is another one, to least squares; 0 of none."""
    size = float(before @ before)
    return float(moved @ before) / size if size else 0.0


def _norm(forces: FloatArray) -> float:
    # A hopeless trial may overflow: its norm is infinite, and it is refused for that.
    with np.errstate(over="ignore", invalid="ignore"):
        return float(np.linalg.norm(forces))


def _stalled(norm: float) -> str:
    return f"the equilibrium iteration stalled at a residual of {norm:.3g} µN"


def _rounded_force(problem: Problem) -> float:
    """Norm of the nodal forces that a strain of `ROUNDED_STRAIN` would make [µN]."""
    areas = np.abs(problem.gradients).sum(axis=3) * problem.weights[:, :, None]
    nodal = np.bincount(problem.cells.ravel(), areas.sum(axis=1).ravel())
    return ROUNDED_STRAIN * float(problem.points.local[:, P_C11].max() * np.linalg.norm(nodal))
