"""Time stepping: step cutting and regrowth, by convergence and by accuracy."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from meshes.arrays import FloatArray
from solver_adapters.bundled.equilibrium import Equilibrium, NotConvergedError, Trial
from solver_adapters.bundled.fem.problem import Problem, Tangents
from solver_adapters.bundled.fem.state import Increment, Instant
from solver_adapters.bundled.law.gauss_points import PointTangents
from solver_adapters.bundled.law.integration_error import stress_error
from solver_adapters.bundled.sensitivities import Differentiation
from solver_adapters.bundled.statistics import Statistics
from solver_adapters.interface import SolverError, Trajectory
from solver_adapters.time_steps import between_instants

MOST_HALVINGS = 10
# A time in which no system slips by a countable amount [s].
_NO_TIME = 1e-12


class Stepper:
    """Advances one problem in time."""

    def __init__(
        self,
        problem: Problem,
        tangents: Tangents,
        tolerance: float,
        accuracy: float | None = None,
        cell_fields: bool = False,
        near: Trajectory | None = None,
    ) -> None:
        self.problem = problem
        self.tangents = tangents
        self.accuracy = accuracy
        self.cell_fields = cell_fields
        self.near = near
        self.statistics = Statistics()
        self._equilibrium = Equilibrium(problem, tolerance, self.statistics)
        self._differentiation = Differentiation(self._equilibrium, tangents)
        self._last: dict[bool, Increment] = {}
        self._course: list[FloatArray] = []

    def start(self, begin: float) -> Instant:
        """Return state at time `begin`: at rest, or in elastic equilibrium with its eigenstrain.

        Raises:
            SolverError: the eigenstrain finds no equilibrium.
        """
        p, k = self.problem, self.tangents.count
        n_points = p.points.grain.size
        kept = n_points if self.cell_fields else 0
        instant = Instant(
            time=begin,
            u=np.zeros((p.n_nodes, 3)),
            H=np.zeros((n_points, 9)),
            state=p.state,
            force=0.0,
            du=np.zeros((p.n_nodes, 3, k)),
            dstate=self.tangents.state,
            dforce=np.zeros(k),
            slip=np.zeros((kept, p.points.n_systems)),
            P=np.zeros((kept, 9)),
        )
        if not p.strained:
            return instant
        # In no time nothing slips.
        still = np.zeros((p.prescribed.size, k))
        try:
            trial = self._equilibrium.solve_step(
                instant, np.zeros(p.prescribed.size), _NO_TIME, self._last
            )
            return self._accept(instant, trial, begin, _NO_TIME, lambda _: still, self.tangents.law)
        except NotConvergedError as failure:
            raise SolverError(
                f"no equilibrium with the eigenstrain before loading: {failure}"
            ) from None

    def resume(
        self,
        last: dict[bool, Increment],
        ends: list[float],
        course: list[FloatArray],
        counts: tuple[int, int, int, int],
    ) -> None:
        """Take over what an earlier run has learnt and counted."""
        self._last = dict(last)
        self._course = list(course)
        s = self.statistics
        s.ends = list(ends)
        s.steps, s.iterations, s.cuts, s.refinements = counts

    @property
    def last(self) -> dict[bool, Increment]:
        """The last increments, by whether the boundary moved."""
        return self._last

    @property
    def course(self) -> list[FloatArray]:
        """The displacement at the end of each step [µm], (n_nodes, 3)."""
        return self._course

    def keep(self, instant: Instant) -> None:
        """Leave this instant, and no longer another one, as it is in the steps that follow."""
        self._differentiation.keep(instant)

    def advance(
        self,
        instant: Instant,
        ends: FloatArray,
        motion: Callable[[float], FloatArray],
        motion_tangent: Callable[[float], FloatArray],
        law: PointTangents,
    ) -> Instant:
        """Go through the ends of the asked steps; cut where needed, regrow afterwards.

        A step is cut where it does not converge, and where its error is above `accuracy`.

        Args:
            instant: where to begin; its derivatives are gone unless it is kept.
            ends: ends of the asked steps [s].
            motion: prescribed motion at a time [s], (n_prescribed,).
            motion_tangent: its derivative, (n_prescribed, k).
            law: derivative of the law in these steps.

        Raises:
            SolverError: a step of 1/1024 of the asked size does not converge; the message names
                time, element and grain.
        """
        for end in ends:
            instant = self._reach(instant, float(end), motion, motion_tangent, law)
        return instant

    def _reach(
        self,
        instant: Instant,
        end: float,
        motion: Callable[[float], FloatArray],
        motion_tangent: Callable[[float], FloatArray],
        law: PointTangents,
    ) -> Instant:
        whole = end - instant.time
        size = whole
        while instant.time < end - 1e-9 * whole:
            size = min(size, end - instant.time)
            target = instant.time + size
            if end - target < 1e-9 * whole:
                target = end
            dt = target - instant.time
            divisible = 0.5 * size >= whole / 2**MOST_HALVINGS
            near = self._step_of_warm_start(instant, target)
            try:
                trial = self._equilibrium.solve_step(instant, motion(target), dt, self._last, near)
            except NotConvergedError as failure:
                if not divisible:
                    raise SolverError(
                        f"no solution at t = {target:.6g} s with steps cut to {size:.3g} s: "
                        f"{failure}"
                    ) from None
                self.statistics.cuts += 1
                size *= 0.5
                continue
            error = 0.0 if self.accuracy is None else self._force_error(instant, trial, dt)
            if self.accuracy is not None and error > self.accuracy and divisible:
                self.statistics.refinements += 1
                size *= 0.5
                continue
            instant = self._accept(instant, trial, target, dt, motion_tangent, law, near)
            self.statistics.steps += 1
            self.statistics.ends.append(target)
            self._course.append(instant.u)
            if self.accuracy is None or error < 0.5 * self.accuracy:
                size = min(2 * size, whole)
        return instant

    def _accept(
        self,
        instant: Instant,
        trial: Trial,
        end: float,
        dt: float,
        motion_tangent: Callable[[float], FloatArray],
        law: PointTangents,
        near: FloatArray | None = None,
    ) -> Instant:
        """Return the instant at the end of a converged step, with its derivatives."""
        p = self.problem
        held = trial.u.ravel()[p.prescribed] - instant.u.ravel()[p.prescribed]
        near = np.zeros_like(trial.u) if near is None else near
        self._last[trial.moves] = Increment(trial.u - instant.u, trial.slips, held, dt, near)
        du, dstate, dforce = instant.du, instant.dstate, instant.dforce
        if self.tangents.count:
            try:
                du, dstate, dforce = self._differentiation.derive(
                    instant, trial, dt, motion_tangent(end), law
                )
            except NotConvergedError as failure:
                # The step cannot be cut any more: its derivatives are half changed.
                raise SolverError(f"no derivatives at t = {end:.6g} s: {failure}") from None
        force = float(trial.forces[p.pulled].sum())
        slip, P = instant.slip, instant.P
        if self.cell_fields:
            slip, P = instant.slip + trial.slips, trial.P
        return Instant(end, trial.u, trial.H, trial.state, force, du, dstate, dforce, slip, P)

    def _step_of_warm_start(self, instant: Instant, target: float) -> FloatArray | None:
        """Return what the nearby simulation did from an instant to a time [µm], (n_nodes, 3)."""
        if self.near is None:
            return None
        times, u = self.near.times, self.near.displacement
        return between_instants(target, times, u) - between_instants(instant.time, times, u)

    def _force_error(self, instant: Instant, trial: Trial, dt: float) -> float:
        """Error of the force that the step may have made [µN]."""
        p = self.problem
        change = trial.H - instant.H
        stress = stress_error(p.points, instant.state, trial.slips, change, dt)
        return float(p.weights.ravel() @ stress) / p.length
