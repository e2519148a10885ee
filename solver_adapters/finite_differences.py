"""Derivatives for adapters without any: differences of runs on both sides, divided.

Along each direction the response is computed at +h and −h beside the asked run. Two runs for each
direction are twice the cost of one-sided differences. They buy an error that falls with h² instead
of h, so that h can be large against the noise of the solver, and a check: what the slopes to both
sides differ from their mean bounds the error of the mean. Where that is too much, two more runs
are made with a smaller step, or with a larger one where noise explains the difference or nothing
is seen to change.

A solver that iterates to a relative tolerance ε answers with about that much noise. Over the scale
L of a direction the response changes by a share of order one, and the error of a central
difference is about ε L/h + (h/L)² (on a prism in cycles the second term has factors from 0.2 to 5),
least at h = (ε/2)^⅓ L: 1.7 % of the scale for ε = 1e-5.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Event, Lock

import numpy as np

from solver_adapters.checks.directions import refuse_bad_directions
from solver_adapters.crystal import rotation_vector_matrix
from solver_adapters.grain_scalars import as_honoured
from solver_adapters.interface import (
    Adapter,
    Capabilities,
    Direction,
    PreparedError,
    Progress,
    Response,
    Simulation,
    SolverError,
    UnsupportedError,
)
from solver_adapters.jobs.errors import is_by_circumstances
from solver_adapters.material import scalar, with_parameters
from solver_adapters.quotient import MOST_STEPS, Pair, Slope, best_of, following_step, slope_through
from solver_adapters.tasks import executor_elsewhere, is_one_of_several
from solver_adapters.time_steps import once_more

RUNS_PER_DIRECTION = 2  # one on each side; twice as many where the first step does not do
_MOST_REPEATS = 2  # of three runs in common time steps


@dataclass(frozen=True, eq=False)
class _Asked:
    """The asked run of a direction, and derivatives about it by some steps."""

    simulation: Simulation
    base: Response
    slopes: list[Slope]


class FiniteDifferences:
    """An adapter that gives another one derivatives.

    A derivative costs two runs, up to twelve where its first step does not do, and three more for
    each step of which the runs took other time steps than the asked one.

    Attributes:
        adapter: the solver.
        processes: how many runs are made at a time, each waited for by a thread: more than one
            only for a solver that runs outside of this process. A process that is itself one of
            several side by side makes one at a time.
        name: that of the solver.
    """

    def __init__(self, adapter: Adapter, processes: int = 1) -> None:
        self.adapter = adapter
        self.processes = processes
        self.name = adapter.name

    def capabilities(self) -> Capabilities:
        """Those of the solver, and derivatives at the price of runs."""
        own = self.adapter.capabilities()
        return replace(own, derivatives=True, times=True, runs_per_direction=RUNS_PER_DIRECTION)

    def version(self) -> str:
        """Return the version of the solver, which keeps its jobs by it."""
        return self.adapter.version()

    def solve(
        self,
        simulation: Simulation,
        workspace: Path | None = None,
        progress: Callable[[Progress], None] | None = None,
    ) -> Response:
        """Run the simulation, and others beside it for its derivatives.

        What makes a derivative doubtful is said in `Response.notes`.

        Args:
            simulation: what to solve.
            workspace: a folder for files of the runs.
            progress: called as the runs advance, with the number of each among all.

        Raises:
            UnsupportedError: a direction changes what the solver cannot honour.
            BadSimulationError: a direction does not fit the simulation.
            PreparedError: jobs were written to be run elsewhere; the folders of all are in it.
            JobError: a run was killed, ran out of time or memory, or left no result.
            SolverError: as the solver, or the runs along a direction could not be made.
        """
        begun = time.monotonic()
        directions, plain = simulation.directions, replace(simulation, directions=())
        if not directions:
            return self.adapter.solve(plain, workspace, progress)
        rows = [row for row, direction in enumerate(directions) if _moves(direction)]
        moving = [directions[row] for row in rows]
        count = _Count(1 + RUNS_PER_DIRECTION * len(moving), progress)
        refuse_bad_directions(simulation)
        self._refuse_unsupported(directions)
        noise = self.adapter.capabilities().noise
        share = (noise / 2) ** (1 / 3)
        first = [(direction, share * direction.scale) for direction in moving]
        base = self._beside_pairs(plain, first, workspace, count)
        repeated, middle = once_more(plain, base), base
        if base.cuts and repeated.steps is not plain.steps:
            # Steps that are given are not taken as those that were chosen: runs of one deck differ
            # by less than those of two.
            count.more(1)
            middle = self._beside_pairs(repeated, first, workspace, count)
        pairs = self._pairs(repeated, first, workspace, count)
        asked = [_Asked(repeated, middle, [slope_through(middle, pair, noise)]) for pair in pairs]
        for k, direction in enumerate(moving):
            asked[k] = self._in_common_steps(asked[k], direction, workspace, count)
        for _ in range(1, MOST_STEPS):
            wanted = {
                k: step
                for k, (direction, known) in enumerate(zip(moving, asked, strict=True))
                if (step := following_step(known.slopes, direction.scale))
            }
            # Those in the steps of the asked run go side by side, others have steps of their own.
            alike = [k for k in wanted if asked[k].simulation is repeated]
            groups = [alike, *([k] for k in wanted if k not in alike)]
            count.more(RUNS_PER_DIRECTION * len(wanted))
            for group in groups:
                again = [(moving[k], wanted[k]) for k in group]
                if not again:
                    continue
                simulation = asked[group[0]].simulation
                pairs = self._pairs(simulation, again, workspace, count)
                for k, pair in zip(group, pairs, strict=True):
                    found = slope_through(asked[k].base, pair, noise)
                    alone = _Asked(simulation, asked[k].base, [found])
                    common = self._in_common_steps(alone, moving[k], workspace, count)
                    asked[k].slopes.extend(common.slopes)
        slopes = [best_of(known.slopes) for known in asked]
        notes = [
            note
            for direction, slope in zip(moving, slopes, strict=True)
            for note in slope.doubts(direction)
        ]
        # Along what moves nothing the derivative is exactly 0, without a run.
        d_displacement = np.zeros((len(directions), *base.displacement.shape))
        d_force = np.zeros((len(directions), *base.force.shape))
        for row, slope in zip(rows, slopes, strict=True):
            d_displacement[row], d_force[row] = slope.displacement, slope.force
        return replace(
            base,
            d_displacement=d_displacement,
            d_force=d_force,
            seconds={**base.seconds, "finite differences": time.monotonic() - begun},
            notes=(*base.notes, *notes),
        )

    def _beside_pairs(
        self,
        simulation: Simulation,
        steps: Sequence[tuple[Direction, float]],
        workspace: Path | None,
        count: _Count,
    ) -> Response:
        """Return the run between the pairs; where it is prepared only, they are, too.

        Raises:
            PreparedError: jobs are prepared; the folders of all are in it.
        """
        try:
            response = self.adapter.solve(simulation, workspace, count.tell)
        except PreparedError as error:
            try:
                self._pairs(simulation, steps, workspace, count)
            except PreparedError as others:
                raise PreparedError.together([error, others]) from None
            raise
        count.ended()
        return response

    def _in_common_steps(
        self, asked: _Asked, direction: Direction, workspace: Path | None, count: _Count
    ) -> _Asked:
        """Return three runs in the steps of the one that took most, if they took others.

        Args:
            asked: the runs in steps of their own.
            direction: along which they are.
            workspace: a folder for files of the runs.
            count: of the runs.
        """
        for _ in range(_MOST_REPEATS):
            (slope,) = asked.slopes
            fit = slope.same_steps and not (slope.doubtful and slope.other_steps)
            if fit or slope.ends is None:
                break
            simulation = replace(asked.simulation, steps=slope.ends, accuracy=None)
            count.more(1 + RUNS_PER_DIRECTION)
            try:
                base = self.adapter.solve(simulation, workspace, count.tell)
                count.ended()
                (pair,) = self._pairs(simulation, [(direction, slope.step)], workspace, count)
            except SolverError as error:
                if is_by_circumstances(error):
                    raise
                break
            # Where one was cut once more, the next try is in its steps.
            found = slope_through(base, pair, self.adapter.capabilities().noise)
            asked = _Asked(simulation, base, [found])
        return asked

    def _refuse_unsupported(self, directions: Sequence[Direction]) -> None:
        offered = self.adapter.capabilities()
        known = offered.material
        for direction in directions:
            if direction.lattice_gradient is not None and not offered.lattice_gradient:
                raise UnsupportedError(
                    f"direction {direction.name!r} changes lattice_gradient, which the solver "
                    f"{self.name} cannot honour; expected None"
                )
            for name in direction.material:
                if as_honoured(name) not in known:
                    raise UnsupportedError(
                        f"direction {direction.name!r} changes {name}, which the solver "
                        f"{self.name} cannot honour; expected one of {', '.join(sorted(known))}"
                    )

    def _pairs(
        self,
        simulation: Simulation,
        steps: Sequence[tuple[Direction, float]],
        workspace: Path | None,
        count: _Count,
    ) -> list[Pair]:
        """Two runs along each direction, at ± a step or where else they succeed.

        Raises:
            PreparedError: jobs are prepared; the folders of all are in it.
            SolverError: no run on a side of a direction, nor at half of it on the other.
        """
        asked = [_Run(direction, sign * step) for direction, step in steps for sign in (1, -1)]
        found = self._outcomes(simulation, asked, workspace, count)
        failed = [i for i, outcome in enumerate(found) if _failed(outcome)]
        # A constant at its bound has one side only; the parabola through two points there will do.
        others = [_Run(asked[i].direction, -asked[i].amount / 2) for i in failed]
        count.more(len(others))
        for i, run, outcome in zip(
            failed, others, self._outcomes(simulation, others, workspace, count), strict=True
        ):
            if _failed(outcome):
                raise SolverError(
                    f"derivative along {run.direction.name!r}: no run at {asked[i].amount:.3g} nor "
                    f"at {run.amount:.3g} from the asked one could be made: {found[i]}"
                )
            asked[i], found[i] = run, outcome
        prepared = [outcome for outcome in found if isinstance(outcome, PreparedError)]
        if prepared:
            raise PreparedError.together(prepared)
        points = [
            (run.amount, outcome)
            for run, outcome in zip(asked, found, strict=True)
            if isinstance(outcome, Response)
        ]
        return list(zip(points[::2], points[1::2], strict=True))

    def _outcomes(
        self, simulation: Simulation, runs: Sequence[_Run], workspace: Path | None, count: _Count
    ) -> list[Response | SolverError]:
        """Return what became of each run, in their order."""
        stop, elsewhere = Event(), executor_elsewhere()

        def heed(state: Progress) -> None:
            if stop.is_set():
                raise _StoppedError
            count.tell(state)

        def outcome(run: _Run) -> Response | SolverError:
            moved = shifted(simulation, run.direction, run.amount)
            try:
                if elsewhere is None:
                    answer = self.adapter.solve(moved, workspace, heed)
                else:
                    answer = elsewhere.submit(self.adapter.solve, moved, workspace).result()
            except PreparedError as error:
                return error
            except SolverError as error:
                # A constant at its bound fails; a run that was killed or truncated is no bound.
                if is_by_circumstances(error):
                    raise
                return error
            finally:
                count.ended()
            # The ends of its steps on the clock of the asked run, whose steps they should be.
            return replace(answer, ends=np.interp(answer.ends, moved.times, simulation.times))

        workers = min(len(runs), 1 if is_one_of_several() else self.processes)
        if workers <= 1:
            return [outcome(run) for run in runs]
        with ThreadPoolExecutor(workers) as pool:
            futures = [pool.submit(outcome, run) for run in runs]
            try:
                for future in as_completed(futures):
                    future.result()
            except BaseException:
                # Ctrl-C reaches this thread alone: the others learn of it as they report progress.
                stop.set()
                pool.shutdown(wait=False, cancel_futures=True)
                raise
        return [future.result() for future in futures]


class _Count:
    """Runs that have ended, and how many there are to be; threads share it."""

    def __init__(self, runs: int, progress: Callable[[Progress], None] | None) -> None:
        self._runs, self._done, self._progress, self._lock = runs, 0, progress, Lock()

    def more(self, runs: int) -> None:
        """Count runs that come on top."""
        with self._lock:
            self._runs += runs

    def ended(self) -> None:
        """Count a run that has ended."""
        with self._lock:
            self._done += 1

    def tell(self, state: Progress) -> None:
        """How far a run is, with its number; runs side by side have the same."""
        if self._progress is not None:
            with self._lock:
                self._progress(replace(state, run=self._done + 1, runs=self._runs))


class _StoppedError(Exception):
    """The runs beside have ended in an error, or by Ctrl-C."""


@dataclass(frozen=True, eq=False)
class _Run:
    """A run at a distance along a direction."""

    direction: Direction
    amount: float


def _moves(direction: Direction) -> bool:
    """Whether a direction changes anything of a simulation at all."""
    tangents = (
        direction.rotation, direction.lattice_gradient, direction.motion, direction.points,
        direction.times, *direction.material.values(),
    )  # fmt: skip
    return any(tangent is not None and bool(np.any(tangent)) for tangent in tangents)


def shifted(simulation: Simulation, direction: Direction, amount: float) -> Simulation:
    """Return simulation at a distance along a direction, without directions and fields of cells."""
    s, m = simulation, simulation.material
    changes = {name: scalar(m, name) + amount * rate for name, rate in direction.material.items()}
    mesh, orientations, motion, gradient = s.mesh, s.orientations, s.motion, s.lattice_gradient
    times, steps, warm_start = s.times, s.steps, s.warm_start
    if direction.rotation is not None:
        turns = [rotation_vector_matrix(amount * rate) for rate in direction.rotation]
        orientations = np.stack(turns) @ orientations
    if direction.lattice_gradient is not None:
        gradient = (0.0 if gradient is None else gradient) + amount * direction.lattice_gradient
    if direction.motion is not None:
        motion = motion + amount * direction.motion
    if direction.points is not None:
        mesh = replace(mesh, points=mesh.points + amount * direction.points)
    if direction.times is not None:
        times = s.times + amount * direction.times
        # Each step keeps its share of its interval.
        steps = None if steps is None else np.interp(steps, s.times, times)
        if warm_start is not None:
            warm_start = replace(warm_start, times=np.interp(warm_start.times, s.times, times))
    return replace(
        s,
        mesh=mesh,
        material=with_parameters(m, changes),
        orientations=orientations,
        times=times,
        motion=motion,
        lattice_gradient=gradient,
        steps=steps,
        warm_start=warm_start,
        directions=(),
        cell_fields=False,
    )


def _failed(outcome: Response | SolverError) -> bool:
    return isinstance(outcome, SolverError) and not isinstance(outcome, PreparedError)
