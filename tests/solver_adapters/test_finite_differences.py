"""Finite differences of a solver in closed form: steps, notes, failures, processes."""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path
from threading import Barrier, current_thread

import numpy as np
import pytest

from meshes.arrays import FloatArray
from solver_adapters import finite_differences
from solver_adapters.finite_differences import FiniteDifferences
from solver_adapters.interface import (
    Adapter,
    BadSimulationError,
    Capabilities,
    Direction,
    NotRunError,
    PreparedError,
    Progress,
    Response,
    Simulation,
    SolverError,
    Trajectory,
    UnsupportedError,
)
from solver_adapters.jobs.errors import JobError
from solver_adapters.jobs.status import CACHED, Status
from solver_adapters.material import Material
from solver_adapters.result_files import ResultFileError
from solver_adapters.tasks import elsewhere
from tools.boxes import box, pulled

Report = Callable[[Progress], None]


@dataclass(eq=False)
class Toy:
    """A solver in closed form: force and displacement are exponentials of tau0, linear in c.

    Attributes:
        noise: standard deviation of each number, in shares of it.
        before: called with simulation and folder before each answer; it may raise.
        kink: the response to tau0 is its distance from 40.
        asked: the simulations, as they came.
        folders: their folders.
    """

    noise: float = 0.0
    before: Callable[[Simulation, Path | None, Report], None] = lambda simulation, folder, heed: (
        None
    )
    kink: bool = False
    asked: list[Simulation] = field(default_factory=list)
    folders: list[Path | None] = field(default_factory=list)
    name: str = "toy"

    def capabilities(self) -> Capabilities:
        known = frozenset({"tau0", "c"})
        return Capabilities(known, frozenset({"small", "finite"}), derivatives=False)

    def version(self) -> str:
        return "7"

    def solve(
        self, simulation: Simulation, workspace: Path | None = None, progress: Report | None = None
    ) -> Response:
        assert simulation.directions == ()
        self.asked.append(simulation)
        self.folders.append(workspace)
        self.before(simulation, workspace, progress or (lambda state: None))
        m = simulation.material
        x = m.tau0 / 40 - 1
        curve = 1 + abs(x) if self.kink else np.exp(x)
        shape = (len(simulation.output), len(simulation.output_nodes), 3)
        force = curve * np.linspace(1, 2, shape[0]) + m.c / 40e3
        displacement = curve * np.ones(shape)
        # The same simulation scatters in the same way.
        rng = np.random.default_rng(abs(hash((m.tau0, m.c))))
        force *= 1 + self.noise * rng.normal(size=force.shape)
        displacement *= 1 + self.noise * rng.normal(size=shape)
        return Response(displacement, force, np.zeros((0, *shape)), np.zeros((0, shape[0])))


ALONG_TAU0 = Direction("tau0", material={"tau0": 1.0}, scale=40.0)
ALONG_C = Direction("c", material={"c": 1.0}, scale=40e3)
BOTH = (ALONG_TAU0, ALONG_C)


def along(*directions: Direction) -> Simulation:
    return replace(pulled(box(), Material(), (0.002, 0.004)), directions=directions)


def _error_of_tau0(response: Response) -> float:
    """Of the whole derivative, whose exact value is the response to tau0 over 40 MPa."""
    n = len(response.force)
    expected = np.concatenate([np.linspace(1, 2, n), np.ones(response.displacement.size)]) / 40
    found = np.concatenate([response.d_force[0], response.d_displacement[0].ravel()])
    return float(np.linalg.norm(found - expected) / np.linalg.norm(expected))


def test_a_step_that_does_costs_two_runs_for_each_direction() -> None:
    solver = Toy()
    response = FiniteDifferences(solver).solve(along(*BOTH))
    assert len(solver.asked) == 1 + 2 * 2
    assert _error_of_tau0(response) < 1e-4
    np.testing.assert_allclose(response.d_force[1], 1 / 40e3, rtol=1e-9)
    np.testing.assert_allclose(response.d_displacement[1], 0.0, atol=1e-12)
    assert response.notes == ()


def test_runs_beside_begin_by_the_way_of_the_asked_one_on_their_own_clock() -> None:
    class Telling(Toy):
        def solve(
            self, simulation: Simulation, workspace: Path | None = None,
            progress: Report | None = None,
        ) -> Response:  # fmt: skip
            still = np.zeros((len(simulation.times), len(simulation.mesh.points), 3))
            found = super().solve(simulation, workspace, progress)
            return replace(found, trajectory=Trajectory(simulation.times, still))

    solver, later = Telling(), np.array([0.0, 0.5, 1.5])
    longer = Direction("hold", times=later, scale=1.0)
    FiniteDifferences(solver).solve(along(ALONG_TAU0, longer))
    assert solver.asked[0].warm_start is None
    assert len(solver.asked) > 4
    for simulation in solver.asked[1:]:
        assert simulation.warm_start is not None
        np.testing.assert_allclose(simulation.warm_start.times, simulation.times)
    assert any(not np.array_equal(s.times, solver.asked[0].times) for s in solver.asked)


def test_without_directions_the_solver_is_asked_once() -> None:
    solver = Toy()
    wrapped: Adapter = FiniteDifferences(solver, 4)
    response = wrapped.solve(along(), Path("here"))
    assert solver.folders == [Path("here")] and response.d_force.shape == (0, 3)
    assert wrapped.capabilities() == replace(
        solver.capabilities(), derivatives=True, times=True, runs_per_direction=2
    )
    assert (wrapped.name, wrapped.version()) == ("toy", "7")


@pytest.mark.parametrize(("factor", "noise"), [(20.0, 0.0), (0.02, 1e-5)])
def test_a_step_too_large_or_too_small_is_changed(factor: float, noise: float) -> None:
    """The scale is wrong: the first step bends the response, or drowns in its noise."""
    solver = Toy(noise)
    direction = replace(ALONG_TAU0, scale=factor * 40)
    response = FiniteDifferences(solver).solve(along(direction))
    assert len(solver.asked) == 1 + 2 + 2
    first, second = (abs(solver.asked[i].material.tau0 - 40) for i in (1, 3))
    assert second < first / 3 if factor > 1 else second > 3 * first
    assert _error_of_tau0(response) < 0.01
    assert response.notes == ()


@pytest.mark.parametrize(("scale", "noise", "kink"), [(1e-3, 1e-5, False), (40.0, 0.0, True)])
def test_a_derivative_that_stays_doubtful_is_noted(scale: float, noise: float, kink: bool) -> None:
    direction = replace(ALONG_TAU0, scale=scale)
    response = FiniteDifferences(Toy(noise, kink=kink)).solve(along(direction, ALONG_C))
    (note,) = response.notes
    assert note.startswith("derivative along 'tau0': uncertain by about ")
    assert note.endswith(f"scale {scale:.3g}); expected 2% or less") and "\n" not in note


def test_what_has_no_effect_is_tried_over_the_widest_step_and_told() -> None:
    solver = Toy()
    response = FiniteDifferences(solver).solve(along(Direction("none", rotation=np.ones((2, 3)))))
    assert not response.d_force.any() and not response.d_displacement.any()
    assert len(solver.asked) == 1 + 2 + 2
    assert response.notes == (
        "derivative along 'none': no change was seen over ± 0.5 (scale 1); the derivative is 0 "
        "within the noise of the solver",
    )


@dataclass(eq=False)
class Rounded(Toy):
    """Answers with six digits, as a result file has them."""

    def solve(
        self, simulation: Simulation, workspace: Path | None = None, progress: Report | None = None
    ) -> Response:
        exact = super().solve(simulation, workspace, progress)

        def digits(values: FloatArray) -> FloatArray:
            return np.array([float(f"{v:.5e}") for v in values.ravel()]).reshape(values.shape)

        return replace(exact, displacement=digits(exact.displacement), force=digits(exact.force))


def test_a_change_below_the_digits_of_a_file_is_found_with_a_wider_step() -> None:
    """The scale is wrong by 1e4: over the first step nothing changes in six digits."""
    direction = replace(ALONG_TAU0, scale=40 * 1e-4)
    solver = Rounded()
    response = FiniteDifferences(solver).solve(along(direction))
    assert len(solver.asked) == 1 + 2 + 2
    assert _error_of_tau0(response) < 0.02 and response.notes == ()


@pytest.mark.parametrize(
    "error",
    [
        *(JobError("toy", status) for status in Status if status not in CACHED),
        ResultFileError("job.frd: found a truncated file"),
    ],
    ids=lambda error: str(getattr(error, "status", "result file")),
)
@pytest.mark.parametrize("processes", [1, 2])
def test_a_run_that_was_ended_is_no_bound_of_a_parameter(
    error: SolverError, processes: int
) -> None:
    def ended(simulation: Simulation, folder: Path | None, heed: Report) -> None:
        if simulation.material.tau0 < 40:
            raise error

    with pytest.raises(type(error), match=f"^{re.escape(str(error))}$"):
        FiniteDifferences(Toy(before=ended), processes).solve(along(ALONG_TAU0))


def test_a_job_that_fails_by_its_parameters_is_replaced() -> None:
    def bounded(simulation: Simulation, folder: Path | None, heed: Report) -> None:
        if simulation.material.tau0 < 40:
            raise JobError("toy", Status.NOT_CONVERGED)

    response = FiniteDifferences(Toy(before=bounded)).solve(along(ALONG_TAU0))
    assert _error_of_tau0(response) < 0.01


@pytest.mark.parametrize("processes", [1, 3])
def test_every_run_is_told_with_its_number_among_all(processes: int) -> None:
    told: list[Progress] = []

    def half_way(simulation: Simulation, folder: Path | None, heed: Report) -> None:
        heed(Progress(0.5, 1.0, 0, 0, 0))

    FiniteDifferences(Toy(1e-6, half_way), processes).solve(along(*BOTH), progress=told.append)
    assert len(told) == 5 and {state.runs for state in told} == {5}
    numbers = [state.run for state in told]
    assert numbers[0] == 1 and numbers == sorted(numbers) and numbers[-1] <= 5
    assert processes > 1 or numbers == [1, 2, 3, 4, 5]


def test_runs_with_a_second_step_are_counted_on_top() -> None:
    told: list[Progress] = []

    def half_way(simulation: Simulation, folder: Path | None, heed: Report) -> None:
        heed(Progress(0.5, 1.0, 0, 0, 0))

    curved = Toy(1e-12, half_way)
    far = replace(ALONG_TAU0, scale=300.0)
    FiniteDifferences(curved).solve(along(far), progress=told.append)
    assert (told[0].runs, told[-1].run) == (3, told[-1].runs)


def test_runs_side_by_side_give_what_runs_one_by_one_give() -> None:
    meeting, base = Barrier(4, timeout=20), along().material

    def meet(simulation: Simulation, folder: Path | None, heed: Report) -> None:
        # All four runs beside the asked one must be here at a time, or this breaks.
        if simulation.material != base:
            meeting.wait()

    beside = FiniteDifferences(Toy(1e-6, meet), 4).solve(along(*BOTH))
    alone = FiniteDifferences(Toy(1e-6), 1).solve(along(*BOTH))
    np.testing.assert_array_equal(beside.d_force, alone.d_force)
    np.testing.assert_array_equal(beside.d_displacement, alone.d_displacement)


def test_runs_go_to_an_executor_elsewhere_as_many_at_a_time_as_are_stated() -> None:
    at_work: list[int] = []
    most: list[int] = []

    def count(simulation: Simulation, folder: Path | None, heed: Report) -> None:
        if simulation.material != along().material:
            assert current_thread().name.startswith("elsewhere")
            at_work.append(1)
            time.sleep(0.05)
            most.append(len(at_work))
            at_work.pop()

    here = FiniteDifferences(Toy(1e-6), 1).solve(along(*BOTH))
    with ThreadPoolExecutor(8, thread_name_prefix="elsewhere") as threads, elsewhere(threads):
        there = FiniteDifferences(Toy(1e-6, count), 2).solve(along(*BOTH))
    assert max(most) == 2
    np.testing.assert_array_equal(there.d_force, here.d_force)
    np.testing.assert_array_equal(there.d_displacement, here.d_displacement)


def test_a_process_that_is_one_of_several_makes_one_run_at_a_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(finite_differences, "is_one_of_several", lambda: True)
    running: list[int] = []

    def alone(simulation: Simulation, folder: Path | None, heed: Report) -> None:
        assert not running
        running.append(1)
        time.sleep(0.01)
        running.pop()

    FiniteDifferences(Toy(before=alone), 4).solve(along(*BOTH))


def test_an_error_ends_the_runs_beside_it() -> None:
    """As Ctrl-C does; without it each of the others would take 20 s."""

    def last(simulation: Simulation, folder: Path | None, heed: Report) -> None:
        if simulation.material.c < 40e3:
            raise RuntimeError("the disk is full")
        begun = time.monotonic()
        while simulation.material != Material() and time.monotonic() < begun + 20:
            heed(Progress(0.0, 1.0, 0, 0, 0))
            time.sleep(0.01)

    begun = time.monotonic()
    with pytest.raises(RuntimeError, match="the disk is full"):
        FiniteDifferences(Toy(before=last), 4).solve(along(*BOTH))
    assert time.monotonic() - begun < 10


def test_a_side_that_fails_is_replaced_by_half_the_step_on_the_other() -> None:
    def bounded(simulation: Simulation, folder: Path | None, heed: Report) -> None:
        if simulation.material.tau0 < 40:
            raise UnsupportedError("tau0 is below 40")

    solver = Toy(before=bounded)
    response = FiniteDifferences(solver).solve(along(ALONG_TAU0))
    high, low, other = (run.material.tau0 - 40 for run in solver.asked[1:])
    assert low == -high and other == pytest.approx(high / 2)
    assert _error_of_tau0(response) < 0.01 and response.notes == ()


def test_a_direction_along_which_nothing_runs_is_named() -> None:
    def narrow(simulation: Simulation, folder: Path | None, heed: Report) -> None:
        if simulation.material.tau0 != 40:
            raise SolverError("no convergence at 3 s")

    with pytest.raises(SolverError) as error:
        FiniteDifferences(Toy(before=narrow)).solve(along(ALONG_C, ALONG_TAU0))
    assert str(error.value) == (
        "derivative along 'tau0': no run at 0.684 nor at -0.342 from the asked one could be made: "
        "no convergence at 3 s"
    )


def test_the_asked_run_fails_as_the_solver_says_and_no_other_is_made() -> None:
    def broken(simulation: Simulation, folder: Path | None, heed: Report) -> None:
        raise SolverError("no convergence at 3 s")

    solver = Toy(before=broken)
    with pytest.raises(SolverError, match=r"^no convergence at 3 s$"):
        FiniteDifferences(solver).solve(along(*BOTH))
    assert len(solver.asked) == 1


@pytest.mark.parametrize("base_is_done", [False, True])
def test_prepared_jobs_are_collected_from_all_runs(base_is_done: bool) -> None:
    def elsewhere(simulation: Simulation, folder: Path | None, heed: Report) -> None:
        if not base_is_done or simulation.material != Material():
            assert folder == Path("jobs")
            m = simulation.material
            raise PreparedError([folder / f"{np.sign(m.tau0 - 40):+.0f}{np.sign(m.c - 40e3):+.0f}"])

    with pytest.raises(PreparedError) as error:
        FiniteDifferences(Toy(before=elsewhere), 2).solve(along(*BOTH), Path("jobs"))
    names = ["+1+0", "-1+0", "+0+1", "+0-1"]
    folders = [Path("jobs") / name for name in names]
    assert error.value.folders == tuple(
        folders if base_is_done else [Path("jobs") / "+0+0", *folders]
    )


@pytest.mark.parametrize("processes", [1, 2])
def test_a_reason_that_no_other_step_would_mend_is_told_as_it_is(processes: int) -> None:
    def absent(simulation: Simulation, folder: Path | None, heed: Report) -> None:
        if simulation.material != Material():
            raise NotRunError("the program is gone")

    with pytest.raises(NotRunError, match="^the program is gone$"):
        FiniteDifferences(Toy(before=absent), processes).solve(along(*BOTH))


def test_other_time_steps_than_those_of_the_asked_run_are_noted() -> None:
    class Stubborn(Toy):
        def solve(
            self,
            simulation: Simulation,
            workspace: Path | None = None,
            progress: Report | None = None,
        ) -> Response:
            steps = 20 if simulation.material.tau0 > 40 else 18
            return replace(super().solve(simulation, workspace, progress), steps=steps)

    response = FiniteDifferences(Stubborn()).solve(along(*BOTH))
    assert response.notes == (
        "derivative along 'tau0': its runs took other time steps than the asked one, whose errors "
        "differ; shorter steps make it better",
    )


def test_directions_that_cannot_be_honoured_are_refused_before_anything_runs() -> None:
    solver = Toy()
    foreign = Direction("hardening", material={"Q": 1.0})
    with pytest.raises(UnsupportedError) as error:
        FiniteDifferences(solver).solve(along(foreign))
    assert str(error.value) == (
        "direction 'hardening' changes Q, which the solver toy cannot honour; "
        "expected one of c, tau0"
    )
    with pytest.raises(UnsupportedError, match="'turn' changes lattice_gradient, which the solver"):
        FiniteDifferences(solver).solve(
            along(Direction("turn", lattice_gradient=np.full((2, 3), 0.01)))
        )
    with pytest.raises(BadSimulationError, match="rotation of direction 'turn' has shape"):
        FiniteDifferences(solver).solve(along(Direction("turn", rotation=np.ones((1, 3)))))
    assert solver.asked == []


def test_runs_that_took_other_steps_are_made_again_in_the_steps_of_the_one_that_took_most() -> None:
    class Cutting(Toy):
        """A step is cut where tau0 is high, unless the steps are given; either errs by 1 %."""

        def solve(
            self,
            simulation: Simulation,
            workspace: Path | None = None,
            progress: Report | None = None,
        ) -> Response:
            found = super().solve(simulation, workspace, progress)
            cut = simulation.material.tau0 > 40 or simulation.steps is not None
            ends = np.array([1.0, 1.5, 2.0] if cut else [1.0, 2.0])
            wrong = 1.0 if cut else 1.01
            return replace(
                found, force=wrong * found.force, displacement=wrong * found.displacement,
                ends=ends, steps=len(ends),
            )  # fmt: skip

    solver = Cutting(1e-6)
    response = FiniteDifferences(solver).solve(along(ALONG_TAU0))
    assert _error_of_tau0(response) < 1e-3
    assert response.notes == ()
    np.testing.assert_array_equal(solver.asked[-1].steps, [1.0, 1.5, 2.0])
    # The answer itself is that in the steps of its own.
    assert response.ends.size == 2


def test_runs_that_took_few_other_steps_are_made_again_where_that_may_make_them_wrong() -> None:
    whole = np.linspace(0.1, 2.0, 20)

    class CuttingOnce(Toy):
        """A single step is cut where tau0 is high, unless the steps are given; it changes 0.1 %."""

        def solve(
            self,
            simulation: Simulation,
            workspace: Path | None = None,
            progress: Report | None = None,
        ) -> Response:
            found = super().solve(simulation, workspace, progress)
            cut = simulation.material.tau0 > 40 or simulation.steps is not None
            ends = np.sort(np.append(whole, 0.15)) if cut else whole
            wrong = 1.0 if cut else 1.001
            return replace(
                found, force=wrong * found.force, displacement=wrong * found.displacement,
                ends=ends, steps=len(ends),
            )  # fmt: skip

    solver = CuttingOnce(1e-6)
    response = FiniteDifferences(solver).solve(along(ALONG_TAU0))
    assert _error_of_tau0(response) < 1e-3 and response.notes == ()
    assert [run.steps is None for run in solver.asked] == 3 * [True] + 3 * [False]


def test_where_the_asked_run_was_cut_differences_are_of_runs_in_given_steps_alone() -> None:
    class Chosen(Toy):
        """A step is cut unless steps are given; either way to the same ends is off by its own."""

        def solve(
            self,
            simulation: Simulation,
            workspace: Path | None = None,
            progress: Report | None = None,
        ) -> Response:
            found = super().solve(simulation, workspace, progress)
            off = 1.0 if simulation.steps is not None else 1.01
            return replace(
                found, force=off * found.force, displacement=off * found.displacement,
                ends=np.array([1.0, 1.5, 2.0]), steps=3, cuts=int(simulation.steps is None),
            )  # fmt: skip

    solver = Chosen()
    response = FiniteDifferences(solver).solve(along(*BOTH))
    assert len(solver.asked) == 1 + 1 + 2 * 2
    assert [run.steps is None for run in solver.asked] == [True] + 5 * [False]
    assert _error_of_tau0(response) < 1e-4 and response.notes == ()
    # The answer itself is that of the asked run.
    plain = Toy().solve(along())
    np.testing.assert_allclose(response.force, 1.01 * plain.force)
    assert response.cuts == 1


def test_where_the_asked_run_was_cut_its_repetition_is_prepared_with_the_runs_beside() -> None:
    class Elsewhere(Toy):
        def solve(
            self,
            simulation: Simulation,
            workspace: Path | None = None,
            progress: Report | None = None,
        ) -> Response:
            if simulation.steps is not None:
                raise PreparedError([Path(f"{simulation.material.tau0 - 40:+.1f}")])
            found = super().solve(simulation, workspace, progress)
            return replace(found, ends=np.array([1.0, 2.0]), steps=2, cuts=1)

    with pytest.raises(PreparedError) as error:
        FiniteDifferences(Elsewhere()).solve(along(ALONG_TAU0), Path("jobs"))
    assert error.value.folders == (Path("+0.0"), Path("+0.7"), Path("-0.7"))
