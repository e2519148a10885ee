"""Time stepping: global Newton with line search, step cutting and regrowth, derivatives."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from solver_adapters.bundled.assembly import (
    direction_forces,
    direction_gradients,
    displacement_gradients,
    element_forces,
)
from solver_adapters.bundled.integration_error import stress_error
from solver_adapters.bundled.law import NS, P_C11
from solver_adapters.bundled.linear import LinearSolverError
from solver_adapters.bundled.problem import Problem, Tangents
from solver_adapters.bundled.statistics import Statistics
from solver_adapters.bundled.tangent_system import TangentSystem
from solver_adapters.bundled.triangles import RESIDUAL
from solver_adapters.interface import SolverError

FloatArray = NDArray[np.float64]

MOST_NEWTON = 14
MOST_HALVINGS = 10
# A residual this far below the reaction is rounding, whatever tolerance was asked for.
ROUNDING = 1e-12
# Strain that rounding leaves behind: of its force nothing better can be asked.
ROUNDED_STRAIN = 1e-15
# Accuracies between which the linear systems of the Newton iteration are solved.
ROUGH, FINE = 1e-3, 1e-8
# A time in which no system slips by a countable amount [s].
_INSTANT = 1e-12


@dataclass(frozen=True, eq=False)
class Increment:
    """A converged step, kept as the start of a later step of the same kind.

    Attributes:
        du: displacement increment, (n_nodes, 3).
        slips: slips of the step, (n_points, 24).
        motion: increment of the prescribed motion, (n_prescribed,).
        dt: length [s].
    """

    du: FloatArray
    slips: FloatArray
    motion: FloatArray
    dt: float


@dataclass(frozen=True, eq=False)
class Frame:
    """State at an instant, and its derivatives along k directions.

    Attributes:
        time: the instant [s].
        u: displacement [µm], (n_nodes, 3).
        H: displacement gradients times the crystal rotations, (n_points, 9).
        state: states of the Gauss points, (n_points, n_state).
        force: force on the pulled face [µN].
        du: derivative of the displacement, (n_nodes, 3, k).
        dstate: derivative of the states, (n_points, k, n_derived).
        dforce: derivative of the force, (k,).
        slip: signed slip since the start, (n_points, 24), or (0, 24) where no cell fields are
            wanted.
        P: first Piola–Kirchhoff stress times the crystal rotations [MPa], (n_points, 9), or
            (0, 9) likewise.
    """

    time: float
    u: FloatArray
    H: FloatArray
    state: FloatArray
    force: float
    du: FloatArray
    dstate: FloatArray
    dforce: FloatArray
    slip: FloatArray = field(default_factory=lambda: np.zeros((0, NS)))
    P: FloatArray = field(default_factory=lambda: np.zeros((0, 9)))


@dataclass(frozen=True, eq=False)
class _Trial:
    """Points and forces at a trial displacement."""

    u: FloatArray
    H: FloatArray
    state: FloatArray
    slips: FloatArray
    P: FloatArray
    C: FloatArray
    forces: FloatArray
    local_failure: int | None


class _NotConverged(Exception):
    """The step has to be cut; the message says what failed where."""


class Stepper:
    """Advances one problem in time."""

    def __init__(
        self,
        problem: Problem,
        tangents: Tangents,
        tolerance: float,
        accuracy: float | None = None,
        cell_fields: bool = False,
    ) -> None:
        self.problem = problem
        self.tangents = tangents
        self.tolerance = tolerance
        self.accuracy = accuracy
        self.cell_fields = cell_fields
        self.statistics = Statistics()
        self._least = _rounded_force(problem)
        self._system = TangentSystem(problem, self.statistics)
        self._last: dict[bool, Increment] = {}
        # Memory of the derivatives, used again since fresh memory has to be cleared.
        n_derived = tangents.state.shape[2]
        self._derivatives = problem.points.memory(tangents.count, n_derived)
        self._states = [self._derivatives.state]
        self._held = tangents.state

    def start(self, begin: float) -> Frame:
        """The state at time `begin`: at rest, or in elastic equilibrium with its eigenstrain.

        Raises:
            SolverError: the eigenstrain finds no equilibrium.
        """
        p, k = self.problem, self.tangents.count
        n_points = p.points.grain.size
        kept = n_points if self.cell_fields else 0
        frame = Frame(
            time=begin,
            u=np.zeros((p.n_nodes, 3)),
            H=np.zeros((n_points, 9)),
            state=p.state,
            force=0.0,
            du=np.zeros((p.n_nodes, 3, k)),
            dstate=self.tangents.state,
            dforce=np.zeros(k),
            slip=np.zeros((kept, NS)),
            P=np.zeros((kept, 9)),
        )
        if not p.strained:
            return frame
        # In no time nothing slips.
        rest = np.zeros((p.prescribed.size, k))
        try:
            trial = self._newton(frame, np.zeros(p.prescribed.size), _INSTANT)
            return self._accept(frame, trial, begin, _INSTANT, rest)
        except _NotConverged as failure:
            raise SolverError(
                f"no equilibrium with the eigenstrain before loading: {failure}"
            ) from None

    def resume(
        self,
        last: dict[bool, Increment],
        ends: list[float],
        counts: tuple[int, int, int, int],
    ) -> None:
        """Take over what an earlier run has learnt and counted."""
        self._last = dict(last)
        s = self.statistics
        s.ends = list(ends)
        s.steps, s.iterations, s.cuts, s.refinements = counts

    @property
    def last(self) -> dict[bool, Increment]:
        """The last increments, by whether the boundary moved."""
        return self._last

    def advance(
        self,
        frame: Frame,
        ends: FloatArray,
        motion: Callable[[float], FloatArray],
        motion_tangent: Callable[[float], FloatArray],
    ) -> Frame:
        """Go through the ends of the asked steps; cut where needed, regrow afterwards.

        A step is cut where it does not converge, and where its error is above `accuracy`.

        Raises:
            SolverError: a step of 1/1024 of the asked size does not converge; the message names
                time, element and grain.
        """
        self._held = frame.dstate
        for end in ends:
            frame = self._reach(frame, float(end), motion, motion_tangent)
        return frame

    def _reach(
        self,
        frame: Frame,
        end: float,
        motion: Callable[[float], FloatArray],
        motion_tangent: Callable[[float], FloatArray],
    ) -> Frame:
        whole = end - frame.time
        size = whole
        while frame.time < end - 1e-9 * whole:
            size = min(size, end - frame.time)
            target = frame.time + size
            if end - target < 1e-9 * whole:
                target = end
            dt = target - frame.time
            divisible = 0.5 * size >= whole / 2**MOST_HALVINGS
            try:
                trial = self._newton(frame, motion(target), dt)
            except _NotConverged as failure:
                if not divisible:
                    raise SolverError(
                        f"no solution at t = {target:.6g} s with steps cut to {size:.3g} s: "
                        f"{failure}"
                    ) from None
                self.statistics.cuts += 1
                size *= 0.5
                continue
            error = 0.0 if self.accuracy is None else self._force_error(frame, trial, dt)
            if self.accuracy is not None and error > self.accuracy and divisible:
                self.statistics.refinements += 1
                size *= 0.5
                continue
            tangent = motion_tangent(target) if self.tangents.count else None
            frame = self._accept(frame, trial, target, dt, tangent)
            self.statistics.steps += 1
            self.statistics.ends.append(target)
            if self.accuracy is None or error < 0.5 * self.accuracy:
                size = min(2 * size, whole)
        return frame

    def _accept(
        self,
        frame: Frame,
        trial: _Trial,
        end: float,
        dt: float,
        motion_tangent: FloatArray | None,
    ) -> Frame:
        """The frame at the end of a converged step, with its derivatives."""
        p = self.problem
        held = trial.u.ravel()[p.prescribed] - frame.u.ravel()[p.prescribed]
        self._last[bool(np.any(held))] = Increment(trial.u - frame.u, trial.slips, held, dt)
        du, dstate, dforce = frame.du, frame.dstate, frame.dforce
        if motion_tangent is not None and self.tangents.count:
            du, dstate, dforce = self._derive(frame, trial, dt, motion_tangent)
        force = float(trial.forces[p.pulled].sum())
        slip, P = frame.slip, frame.P
        if self.cell_fields:
            slip, P = frame.slip + trial.slips, trial.P
        return Frame(end, trial.u, trial.H, trial.state, force, du, dstate, dforce, slip, P)

    def _force_error(self, frame: Frame, trial: _Trial, dt: float) -> float:
        """Error of the force that the step may have made [µN]."""
        p = self.problem
        change = trial.H - frame.H
        stress = stress_error(p.points, frame.state, trial.slips, change, dt)
        return float(p.weights.ravel() @ stress) / p.length

    def _evaluate(self, frame: Frame, u: FloatArray, guess: FloatArray, dt: float) -> _Trial:
        p, clock = self.problem, time.perf_counter()
        H = np.empty((p.points.grain.size, 9))
        displacement_gradients(u, p.cells, p.gradients, H)
        state, slips, P, C, count = p.points.update(H, frame.state, guess, dt, frame.H)
        clock = self.statistics.clock("points", clock)
        forces = np.empty(p.pattern.dofs.shape)
        element_forces(P, p.gradients, p.weights, forces)
        total = p.pattern.node_sum(forces, p.n_nodes)
        self.statistics.clock("assembly", clock)
        failed = int(np.argmin(count)) if count.min() < 0 else None
        return _Trial(u, H, state, slips, P, C, total, failed)

    def _assemble(self, trial: _Trial, moves: bool, fresh: bool = False) -> None:
        """Take the tangent of a trial."""
        try:
            self._system.assemble(trial.C, moves, fresh)
        except LinearSolverError as error:
            raise _NotConverged(self._where(trial, str(error))) from None

    def _solve(self, trial: _Trial, rhs: FloatArray, accuracy: float = RESIDUAL) -> FloatArray:
        """Solve with the tangent of a trial."""
        try:
            return self._system.solve(rhs, accuracy)
        except LinearSolverError as error:
            raise _NotConverged(self._where(trial, str(error))) from None

    def _predict(
        self, frame: Frame, motion: FloatArray, dt: float
    ) -> tuple[FloatArray, FloatArray]:
        """Start of a step: the last step of its kind scaled, or one tangent step."""
        p = self.problem
        moved = motion - frame.u.ravel()[p.prescribed]
        moves = bool(np.any(moved))
        last = self._last.get(moves)
        u = frame.u.copy()
        if last is not None:
            if moves:
                ratio = float(moved @ last.motion / (last.motion @ last.motion))
            else:
                ratio = dt / last.dt
            if 0.0 < ratio < 4.0:
                u += ratio * last.du
                u.ravel()[p.prescribed] = motion
                return u, ratio * last.slips
        rest = np.zeros((p.points.grain.size, NS))
        trial = self._evaluate(frame, frame.u, rest, dt)
        self._assemble(trial, moves)
        lifted = np.zeros((p.n_nodes, 3))
        lifted.ravel()[p.prescribed] = moved
        H = np.empty((p.points.grain.size, 9))
        displacement_gradients(lifted, p.cells, p.gradients, H)
        stress = np.einsum("pij,pj->pi", trial.C, H)
        forces = np.empty(p.pattern.dofs.shape)
        element_forces(stress, p.gradients, p.weights, forces)
        residual = trial.forces + p.pattern.node_sum(forces, p.n_nodes)
        lifted.ravel()[p.pattern.free] = self._solve(trial, -residual[p.pattern.free])
        return frame.u + lifted, rest

    def _newton(self, frame: Frame, motion: FloatArray, dt: float) -> _Trial:
        free, prescribed = self.problem.pattern.free, self.problem.prescribed
        moves = bool(np.any(motion != frame.u.ravel()[prescribed]))
        u, guess = self._predict(frame, motion, dt)
        trial = self._evaluate(frame, u, guess, dt)
        norm = _norm(trial.forces[free])
        for _ in range(MOST_NEWTON):
            reaction = _norm(trial.forces[prescribed])
            target = max(max(self.tolerance, ROUNDING) * reaction, self._least)
            if norm <= target and trial.local_failure is None:
                return trial
            self._assemble(trial, moves)
            # No better than the last iteration needs.
            accuracy = min(ROUGH, max(0.1 * target / norm, FINE))
            step = self._solve(trial, -trial.forces[free], accuracy)
            self.statistics.iterations += 1
            trial, norm = self._line_search(frame, trial, step, norm, dt)
        raise _NotConverged(self._where(trial, _stalled(norm)))

    def _line_search(
        self, frame: Frame, trial: _Trial, step: FloatArray, norm: float, dt: float
    ) -> tuple[_Trial, float]:
        """Halve the step while the residual grows; the best of four, even if it grew in all."""
        free = self.problem.pattern.free
        best, length = None, 1.0
        for _ in range(4):
            u = trial.u.copy()
            u.ravel()[free] += length * step
            candidate = self._evaluate(frame, u, trial.slips, dt)
            new = _norm(candidate.forces[free])
            usable = np.isfinite(new) and candidate.local_failure is None
            if usable and (best is None or new < best[1]):
                best = (candidate, new)
            if usable and new <= norm:
                break
            length *= 0.5
        if best is None:
            raise _NotConverged(self._where(candidate, _stalled(new)))
        return best

    def _where(self, trial: _Trial, what: str) -> str:
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

    def _derive(
        self, frame: Frame, trial: _Trial, dt: float, motion_tangent: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Direct differentiation of the converged step.

        1. explicit change of the forces at fixed free displacements;
        2. K du = −change on the free degrees of freedom;
        3. what du adds to the states and to the pulled force.
        """
        p, t = self.problem, self.tangents
        moves = bool(np.any(trial.u.ravel()[p.prescribed] != frame.u.ravel()[p.prescribed]))
        self._assemble(trial, moves, fresh=True)
        clock = time.perf_counter()
        du = np.zeros((p.n_nodes, 3, t.count))
        flat = du.reshape(3 * p.n_nodes, t.count)
        flat[p.prescribed] = motion_tangent
        dH = np.zeros((trial.H.shape[0], t.count, 9))
        direction_gradients(du, p.cells, p.gradients, dH)
        for slot, index in enumerate(t.geometric):
            part = np.empty_like(trial.H)
            displacement_gradients(trial.u, p.cells, t.gradients[slot], part)
            dH[:, index] += part
        out = replace(self._derivatives, state=self._spare_state(frame))
        p.points.derive(trial.H, frame.state, trial.slips, dt, dH, t.law, frame.dstate, out)
        change = self._force_change(trial, out.stress)
        clock = self.statistics.clock("derivatives", clock)
        follows = self._solve(trial, -change[p.pattern.free])
        clock = time.perf_counter()
        flat[p.prescribed] = 0.0
        flat[p.pattern.free] = follows
        dH[:] = 0.0
        direction_gradients(du, p.cells, p.gradients, dH)
        out.follow(dH)
        # Virtual work of the pulled force: a unit motion of the pulled face against the stress.
        near = p.near_pulled
        added = np.einsum("pi,pij,pkj->k", p.pull[near], trial.C[near], dH[near], optimize=True)
        dforce = change[p.pulled].sum(axis=0) + added
        flat[p.prescribed] = motion_tangent
        self.statistics.clock("derivatives", clock)
        return du, out.state, dforce

    def _spare_state(self, frame: Frame) -> FloatArray:
        """Memory that neither this frame nor the one that `advance` began with holds."""
        for state in self._states:
            if state is not frame.dstate and state is not self._held:
                return state
        self._states.append(np.empty_like(frame.dstate))
        return self._states[-1]

    def _force_change(self, trial: _Trial, dP: FloatArray) -> FloatArray:
        p, t = self.problem, self.tangents
        forces = np.empty((*p.pattern.dofs.shape, t.count))
        direction_forces(dP, p.gradients, p.weights, forces)
        for slot, index in enumerate(t.geometric):
            part = np.empty(p.pattern.dofs.shape)
            element_forces(trial.P, p.gradients, t.weights[slot], part)
            forces[:, :, index] += part
            element_forces(trial.P, t.gradients[slot], p.weights, part)
            forces[:, :, index] += part
        return p.pattern.node_sums(forces, p.n_nodes)


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
