from __future__ import annotations

import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numba
import pytest

from driver.common.progress import progress_to
from driver.common.remaining import foretold
from driver.forward.progress_adapter import ProgressAdapter, sentence_of
from driver.results.kept_responses import KeptResponses
from solver_adapters.bundled.adapter import BundledAdapter
from solver_adapters.interface import Capabilities, Progress, Response, Simulation
from solver_adapters.material import Material
from tools.boxes import box, pulled


def test_each_instant_before_the_last_is_told_and_all_are_passed_on() -> None:
    lines: list[str] = []
    words: list[str] = []
    seen: list[Progress] = []
    simulation = pulled(box(), Material(strain_measure="small"), (0.001, 0.002))
    solver = ProgressAdapter(BundledAdapter())
    with progress_to(lines.append, words.append):
        response = solver.solve(simulation, progress=seen.append)
    assert len(seen) == 2 and words == [sentence_of(seen[0])] and not lines
    assert (seen[-1].steps, seen[-1].iterations) == (response.steps, response.iterations)
    assert (solver.name, solver.version()) == ("bundled", BundledAdapter().version())
    assert solver.capabilities() == BundledAdapter().capabilities()


def test_what_is_told_of_a_run_names_times_counts_and_what_is_left() -> None:
    state = Progress(time=120.0, end=3840.0, steps=6, iterations=21, cuts=1, remaining=12.4)
    assert sentence_of(state) == (
        "simulation at 120 of 3840 s: 6 steps, 21 iterations, 1 cut, 12 s left"
    )
    assert sentence_of(Progress(120.0, 3840.0, 6, 21, 1)).endswith("21 iterations, 1 cut")


def test_a_run_of_an_external_solver_is_told_by_its_instant_and_its_number() -> None:
    first = Progress(time=0.0, end=160.0, steps=0, iterations=0, cuts=0)
    assert sentence_of(first) == "simulation at 0 of 160 s"
    state = Progress(40.0, 160.0, 0, 0, 0, remaining=31.2, run=7, runs=46)
    assert sentence_of(state) == "run 7 of 46: simulation at 40 of 160 s: 31 s left"


def test_a_run_that_waits_for_another_process_tells_for_which() -> None:
    state = Progress(0.0, 160.0, 0, 0, 0, run=7, runs=46, holder="process 12 on node7")
    assert sentence_of(state) == (
        "run 7 of 46: waiting for process 12 on node7, which runs this simulation"
    )


def test_another_process_gets_the_solver_alone() -> None:
    sent = pickle.loads(pickle.dumps(ProgressAdapter(BundledAdapter())))
    assert type(sent) is BundledAdapter


class Job(BundledAdapter):
    """A program of its own that tells nothing of its runs."""

    def capabilities(self) -> Capabilities:
        return replace(super().capabilities(), in_process=False)

    def solve(
        self,
        simulation: Simulation,
        workspace: Path | None = None,
        progress: Callable[[Progress], None] | None = None,
    ) -> Response:
        return super().solve(simulation)


def constant(seconds: float) -> Callable[[Simulation], float]:
    return lambda simulation: seconds


def test_a_run_renews_what_is_left_and_a_kept_response_does_not(tmp_path: Path) -> None:
    """However long it takes to read: of many derivatives it takes a while."""
    simulation = pulled(box(), Material(strain_measure="small"), (0.001, 0.002))
    BundledAdapter().solve(simulation)  # which may compile kernels
    solver = ProgressAdapter(KeptResponses(BundledAdapter(), tmp_path), constant(1e-3))
    for runs in (True, False):
        with foretold({"identify": 1.0}, ("identify",)) as remaining:
            solver.solve(simulation)
            assert (remaining.factor != 1.0) == runs


class Compiling(BundledAdapter):
    """A solver whose first simulation compiles a kernel."""

    compiled = False

    def solve(self, simulation: Simulation, *rest: Any, **more: Any) -> Response:
        if not self.compiled:
            self.compiled = True
            numba.njit(lambda x: x + 1.0)(1.0)
        return super().solve(simulation, *rest, **more)


def test_a_run_that_has_compiled_kernels_tells_nothing_of_the_others() -> None:
    simulation = pulled(box(), Material(strain_measure="small"), (0.001, 0.002))
    BundledAdapter().solve(simulation)
    solver = ProgressAdapter(Compiling(), constant(1e-3))
    with foretold({"identify": 1.0}, ("identify",)) as remaining:
        solver.solve(simulation)
        assert remaining.factor == 1.0
        solver.solve(simulation)
        assert remaining.factor != 1.0


@pytest.mark.parametrize(("foreseen", "counts"), [(1e-3, True), (1e6, False)])
def test_a_job_renews_what_is_left_where_it_took_its_time(foreseen: float, counts: bool) -> None:
    """It may tell of nothing, and one of the store is read in next to no time."""
    simulation = pulled(box(), Material(strain_measure="small"), (0.001, 0.002))
    with foretold({"identify": 1.0}, ("identify",)) as remaining:
        ProgressAdapter(Job(), constant(foreseen)).solve(simulation)
        assert (remaining.factor != 1.0) == counts
