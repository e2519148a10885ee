"""Time stepping: global Newton with line search, step cutting and regrowth, derivatives."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from solver_adapters.bundled.assembly import (
    direction_forces,
    direction_gradients,
    displacement_gradients,
    element_forces,
    element_stiffness,
)
from solver_adapters.bundled.law import N_STATE, NS, P_C11
from solver_adapters.bundled.linear import LinearSolverError, SymmetricSolver
from solver_adapters.bundled.problem import Problem, Tangents
from solver_adapters.interface import SolverError

FloatArray = NDArray[np.float64]

MOST_NEWTON = 14
MOST_HALVINGS = 10
# A residual this far below the reaction is rounding, whatever tolerance was asked for.
ROUNDING = 1e-12
# Strain that rounding leaves behind: of its force nothing better can be asked.
ROUNDED_STRAIN = 1e-15


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
        state: states of the Gauss points, (n_points, 57).
        force: force on the pulled face [µN].
        du: derivative of the displacement, (n_nodes, 3, k).
        dstate: derivative of the states, (n_points, k, 57).
        dforce: derivative of the force, (k,).
    """

    time: float
    u: FloatArray
    state: FloatArray
    force: float
    du: FloatArray
    dstate: FloatArray
    dforce: FloatArray


@dataclass
class Statistics:
    """What a run has cost so far."""

    steps: int = 0
    iterations: int = 0
    cuts: int = 0
    seconds: dict[str, float] = field(default_factory=dict)

    def clock(self, name: str, since: float) -> float:
        """Book the time since an earlier call; returns now."""
        now = time.perf_counter()
        self.seconds[name] = self.seconds.get(name, 0.0) + now - since
        return now


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

    def __init__(self, problem: Problem, tangents: Tangents, tolerance: float) -> None:
        self.problem = problem
        self.tangents = tangents
        self.tolerance = tolerance
        self.statistics = Statistics()
        self._least = _rounded_force(problem)
        self._solver = SymmetricSolver(problem.pattern.indptr, problem.pattern.indices)
        self._last: dict[bool, Increment] = {}

    def start(self, begin: float) -> Frame:
        """The undeformed state at time `begin`."""
        p, k = self.problem, self.tangents.count
        n_points = p.points.grain.size
        return Frame(
            time=begin,
            u=np.zeros((p.n_nodes, 3)),
            state=p.points.initial_state(),
            force=0.0,
            du=np.zeros((p.n_nodes, 3, k)),
            dstate=np.zeros((n_points, k, N_STATE)),
            dforce=np.zeros(k),
        )

    def advance(
        self,
        frame: Frame,
        end: float,
        motion: Callable[[float], FloatArray],
        motion_tangent: Callable[[float], FloatArray],
        steps: int,
    ) -> Frame:
        """Go to time `end` in at least `steps` steps; cut where needed, regrow afterwards.

        Raises:
            SolverError: a step of 1/1024 of the asked size does not converge; the message names
                time, element and grain.
        """
        whole = (end - frame.time) / steps
        size = whole
        while frame.time < end - 1e-9 * whole:
            size = min(size, end - frame.time)
            try:
                target = frame.time + size
                if end - target < 1e-9 * whole:
                    target = end
                frame = self._step(frame, target, motion(target), motion_tangent)
                size = min(2 * size, whole)
            except _NotConverged as failure:
                if 0.5 * size < whole / 2**MOST_HALVINGS:
                    raise SolverError(
                        f"no solution at t = {target:.6g} s with steps cut to {size:.3g} s: "
                        f"{failure}"
                    ) from None
                self.statistics.cuts += 1
                size *= 0.5
        return frame

    def _step(
        self,
        frame: Frame,
        end: float,
        motion: FloatArray,
        motion_tangent: Callable[[float], FloatArray],
    ) -> Frame:
        dt = end - frame.time
        trial = self._newton(frame, motion, dt)
        p = self.problem
        increment = Increment(
            trial.u - frame.u, trial.slips, motion - frame.u.ravel()[p.prescribed], dt
        )
        self._last[bool(np.any(increment.motion))] = increment
        self.statistics.steps += 1
        du, dstate, dforce = frame.du, frame.dstate, frame.dforce
        if self.tangents.count:
            du, dstate, dforce = self._derive(frame, trial, dt, motion_tangent(end))
        force = float(trial.forces[p.pulled].sum())
        return Frame(end, trial.u, trial.state, force, du, dstate, dforce)

    def _evaluate(self, frame: Frame, u: FloatArray, guess: FloatArray, dt: float) -> _Trial:
        p, clock = self.problem, time.perf_counter()
        H = np.empty((p.points.grain.size, 9))
        displacement_gradients(u, p.cells, p.gradients, H)
        state, slips, P, C, count = p.points.update(H, frame.state, guess, dt)
        if count.min() < 0:
            # The guess of another step can mislead; a start from rest seldom does.
            state, slips, P, C, count = p.points.update(H, frame.state, np.zeros_like(guess), dt)
        clock = self.statistics.clock("points", clock)
        forces = np.empty((len(p.cells), 30))
        element_forces(P, p.gradients, p.weights, forces)
        total = p.pattern.node_sum(forces, p.n_nodes)
        self.statistics.clock("assembly", clock)
        failed = int(np.argmin(count)) if count.min() < 0 else None
        return _Trial(u, H, state, slips, P, C, total, failed)

    def _factor(self, trial: _Trial) -> None:
        """Factor the tangent of a trial."""
        p, clock = self.problem, time.perf_counter()
        K = np.empty((len(p.cells), 465))
        element_stiffness(trial.C, p.gradients, p.weights, K)
        values = p.pattern.values(K)
        clock = self.statistics.clock("assembly", clock)
        try:
            self._solver.factor(values)
        except LinearSolverError as error:
            raise _NotConverged(self._where(trial, str(error))) from None
        self.statistics.clock("factorisation", clock)

    def _solve(self, trial: _Trial, rhs: FloatArray) -> FloatArray:
        """Solve with the factors of the tangent of a trial."""
        clock = time.perf_counter()
        try:
            solution = self._solver.solve(rhs)
        except LinearSolverError as error:
            raise _NotConverged(self._where(trial, str(error))) from None
        self.statistics.clock("solution", clock)
        return solution

    def _predict(
        self, frame: Frame, motion: FloatArray, dt: float
    ) -> tuple[FloatArray, FloatArray]:
        """Start of a step: the last step of its kind scaled, or one tangent step."""
        p = self.problem
        moved = motion - frame.u.ravel()[p.prescribed]
        last = self._last.get(bool(np.any(moved)))
        u = frame.u.copy()
        if last is not None:
            if np.any(moved):
                ratio = float(moved @ last.motion / (last.motion @ last.motion))
            else:
                ratio = dt / last.dt
            if 0.0 < ratio < 4.0:
                u += ratio * last.du
                u.ravel()[p.prescribed] = motion
                return u, ratio * last.slips
        rest = np.zeros((p.points.grain.size, NS))
        trial = self._evaluate(frame, frame.u, rest, dt)
        self._factor(trial)
        lifted = np.zeros((p.n_nodes, 3))
        lifted.ravel()[p.prescribed] = moved
        H = np.empty((p.points.grain.size, 9))
        displacement_gradients(lifted, p.cells, p.gradients, H)
        stress = np.einsum("pij,pj->pi", trial.C, H)
        forces = np.empty((len(p.cells), 30))
        element_forces(stress, p.gradients, p.weights, forces)
        residual = trial.forces + p.pattern.node_sum(forces, p.n_nodes)
        lifted.ravel()[p.pattern.free] = self._solve(trial, -residual[p.pattern.free])
        return frame.u + lifted, rest

    def _newton(self, frame: Frame, motion: FloatArray, dt: float) -> _Trial:
        free, prescribed = self.problem.pattern.free, self.problem.prescribed
        u, guess = self._predict(frame, motion, dt)
        trial = self._evaluate(frame, u, guess, dt)
        norm = _norm(trial.forces[free])
        for _ in range(MOST_NEWTON):
            reaction = _norm(trial.forces[prescribed])
            small = norm <= max(max(self.tolerance, ROUNDING) * reaction, self._least)
            if small and trial.local_failure is None:
                return trial
            self._factor(trial)
            step = self._solve(trial, -trial.forces[free])
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
            cell = trial.local_failure // 4
            what = "the crystal law did not converge"
        else:
            force = np.zeros(3 * p.n_nodes)
            force[p.pattern.free] = trial.forces[p.pattern.free]
            node = int(np.argmax(np.linalg.norm(force.reshape(-1, 3), axis=1)))
            cell = int(np.flatnonzero((p.cells == node).any(axis=1))[0])
        grain = int(p.points.grain[4 * cell]) + 1
        return f"{what} (element {cell}, grain {grain})"

    def _derive(
        self, frame: Frame, trial: _Trial, dt: float, motion_tangent: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Direct differentiation of the converged step.

        1. explicit change of the forces at fixed free displacements;
        2. K du = −change on the free degrees of freedom;
        3. change of the states and of the pulled force with the whole du.
        """
        p, t = self.problem, self.tangents
        self._factor(trial)
        clock = time.perf_counter()
        du = np.zeros((p.n_nodes, 3, t.count))
        flat = du.reshape(3 * p.n_nodes, t.count)
        flat[p.prescribed] = motion_tangent
        dH0 = np.zeros((trial.H.shape[0], t.count, 9))
        for slot, index in enumerate(t.geometric):
            part = np.empty_like(trial.H)
            displacement_gradients(trial.u, p.cells, t.gradients[slot], part)
            dH0[:, index] += part
        dH = dH0.copy()
        direction_gradients(du, p.cells, p.gradients, dH)
        dP, _ = self._point_derivative(frame, trial, dt, dH)
        change = self._force_change(trial, dP)
        clock = self.statistics.clock("derivatives", clock)
        flat[p.pattern.free] = self._solve(trial, -change[p.pattern.free])
        clock = time.perf_counter()
        direction_gradients(du, p.cells, p.gradients, dH0)
        dP, dstate = self._point_derivative(frame, trial, dt, dH0)
        dforce = self._force_change(trial, dP)[p.pulled].sum(axis=0)
        self.statistics.clock("derivatives", clock)
        return du, dstate, dforce

    def _point_derivative(
        self, frame: Frame, trial: _Trial, dt: float, dH: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        t = self.tangents
        return self.problem.points.derive(
            trial.H, frame.state, trial.slips, dt, dH, t.rotation, t.local, frame.dstate
        )

    def _force_change(self, trial: _Trial, dP: FloatArray) -> FloatArray:
        p, t = self.problem, self.tangents
        forces = np.empty((len(p.cells), 30, t.count))
        direction_forces(dP, p.gradients, p.weights, forces)
        for slot, index in enumerate(t.geometric):
            part = np.empty((len(p.cells), 30))
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
