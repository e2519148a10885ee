"""What a refinement takes, what a verdict says of it, and when it is made."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from driver.case.model import Case, default_case, load_case, write_case
from driver.common import machine
from driver.forward import build
from driver.results.mesh_sizes import Refinements, read_refinements, sized_case, write_refinements
from driver.workflow import pipeline
from driver.workflow.cost import estimate
from driver.workflow.engine import stage_keys
from driver.workflow.refinement import (
    coarser_again,
    finer_simulation,
    refined_within_budget,
    to_refine,
    told_beforehand,
)
from solver_adapters.bundled.adapter import BundledAdapter
from solver_adapters.interface import Capabilities, PreparedError, SolverError
from tests.driver.stated_sizes import stated_case

HISTORY = "time_s,stage_um,image,force_N\n0,0,0,0\n10,20,1,50\n20,40,2,90\n30,20,3,10\n"
SECONDS = {"mesh": 1.0, "measure": 50.0, "identify": 300.0, "diagnose": 299.0}


class Outside(BundledAdapter):
    """A solver that is a program of its own."""

    def capabilities(self) -> Capabilities:
        return replace(super().capabilities(), in_process=False)


def written(folder: Path, case: Case, **values: Any) -> Path:
    """The file of a case with a history of four images, and other values at keys."""
    path = folder / "case.toml"
    keys = {key.replace("__", "."): value for key, value in values.items()}
    write_case(case.with_values_at(keys), path)
    (folder / "history.csv").write_text(HISTORY, encoding="utf-8")
    (folder / "results").mkdir(exist_ok=True)
    return path


def automatic(folder: Path, **values: Any) -> Case:
    return sized_case(written(folder, default_case(), **values))


def stated(folder: Path, **values: Any) -> Case:
    return load_case(written(folder, stated_case(), **values))


def diagnosed(
    case: Case, verdict: str = "numerics", needed: str | None = "mesh", passed: bool = False
) -> None:
    """What stages up to a diagnosis leave behind, as far as a refinement reads it."""
    results = case.file.parent / "results"
    record = {"verdict": verdict, "numerics": {"needed": needed, "passed": passed}}
    (results / "diagnosis.json").write_text(json.dumps(record))
    keys = stage_keys(pipeline.stages(case), case)
    entries = {
        name: {"key": keys[name], "outputs": [], "finished": "", "seconds": seconds}
        for name, seconds in SECONDS.items()
    }
    (results / "stages.json").write_text(json.dumps(entries))


def asked(case: Case, done: str = "diagnose") -> Case | None:
    return refined_within_budget(case, done, pipeline.stages(case))


def test_what_is_needed_is_named_by_the_keys_that_make_it(tmp_path: Path) -> None:
    case = stated(tmp_path)
    mesh = {"specimen.mesh_size_um": 2.0, "specimen.fine_mesh_size_um": 0.667}
    steps = {"solver.steps_per_interval": 2, "solver.fine_steps_per_interval": 4}
    assert finer_simulation(case, "mesh", 1.0).keys == mesh
    assert finer_simulation(case, "steps", 1.0).keys == steps
    both = finer_simulation(case, "mesh and steps", 1.0)
    assert both.keys == mesh | steps
    assert (both.case.specimen.mesh_size, both.case.solver.steps_per_interval) == (2.0, 2)
    exact = stated(tmp_path, solver__accuracy_uN=3.0)
    assert finer_simulation(exact, "steps", 1.0).keys == {"solver.accuracy_uN": 1.5}


def test_the_time_is_that_of_the_run_times_the_ratio_of_the_estimates(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    case, solver = stated(tmp_path), BundledAdapter().capabilities()
    finer = finer_simulation(case, "mesh", 100.0)
    cells = [len(build.mesh_of(case, size).cells) for size in (2.0, 2.0)]
    now, then = estimate(case, solver, cells[0], 4), estimate(finer.case, solver, cells[1], 4)
    assert then.seconds > 2 * now.seconds and finer.cost.memory == then.memory
    assert finer.cost.seconds == pytest.approx(100.0 * then.seconds / now.seconds)
    # Jobs that were run before took no time in this one.
    monkeypatch.setattr(build, "find_adapter", lambda name, profile: Outside())
    assert finer_simulation(case, "mesh", 0.0).cost.seconds == pytest.approx(then.seconds)


def test_stated_sizes_get_the_keys_to_write_with_time_and_memory(tmp_path: Path) -> None:
    case = stated(tmp_path)
    diagnosed(case)
    told = to_refine(case, "mesh", 299.0)
    assert told.startswith(
        "Write specimen.mesh_size_um = 2 and specimen.fine_mesh_size_um = 0.667, then run again: "
        "that takes about "
    )
    assert told.endswith(" GB of memory.") and " min on free cores and " in told
    told = to_refine(case, "steps", 299.0)
    assert told.startswith(
        "Write solver.steps_per_interval = 2 and solver.fine_steps_per_interval = 4, then"
    )


def test_automatic_sizes_get_the_budget_to_write_where_theirs_is_spent(tmp_path: Path) -> None:
    case = automatic(tmp_path, execution__budget_min=11.0)
    diagnosed(case)
    again = finer_simulation(case, "mesh", 600.0).cost.seconds
    minutes = 1.1 * (50.0 + 600.0 + again) / 60
    told = to_refine(case, "mesh", 299.0)
    budget = float(told.split("execution.budget_min = ")[1].split(",")[0])
    assert minutes <= budget <= 1.1 * minutes + 1
    assert ", then run again: meshes of 2 and 0.667 µm take about " in told
    # The budget that is named is one that holds it.
    written(tmp_path, load_case(case.file), execution__budget_min=budget)
    enough = sized_case(case.file)
    assert to_refine(enough, "mesh", 299.0).startswith("The run refines the meshes next: 2 and ")
    assert asked(enough) is not None


def test_automatic_sizes_get_the_steps_alone_where_both_are_needed(tmp_path: Path) -> None:
    case = automatic(tmp_path)
    diagnosed(case)
    told = to_refine(case, "mesh and steps", 299.0)
    assert "solver.steps_per_interval = 2" in told and "mesh_size_um" not in told


def test_meshes_are_refined_while_the_budget_holds_it(tmp_path: Path, lines: list[str]) -> None:
    case = automatic(tmp_path, execution__budget_min=600.0)
    diagnosed(case)
    finer = asked(case)
    assert finer is not None and finer.specimen.refined == 1
    assert (finer.specimen.mesh_size, finer.specimen.fine_mesh_size) == (2.0, 0.667)
    # The measurement is not made again.
    assert read_refinements(tmp_path / "results") == Refinements(1, 600.0)
    assert sized_case(case.file).specimen == finer.specimen
    assert lines[-1].startswith(
        "the mesh keeps the verdict open and is refined: 2 and 0.667 µm take about "
    )
    assert lines[-1].endswith("h of execution.budget_min = 600 are left")


def test_time_of_coarser_meshes_counts_in_the_budget(tmp_path: Path, lines: list[str]) -> None:
    case = automatic(tmp_path, execution__budget_min=600.0)
    write_refinements(tmp_path / "results", Refinements(0, 60 * 599.0))
    diagnosed(case)
    assert asked(case) is None
    assert lines[-1].startswith("not refined, for lack of time: 2 and 0.667 µm take about ")
    assert read_refinements(tmp_path / "results").level == 0


def test_meshes_that_cannot_be_simulated_give_way_to_those_before_and_are_not_tried_again(
    tmp_path: Path, lines: list[str]
) -> None:
    case = automatic(tmp_path, execution__budget_min=600.0)
    diagnosed(case)
    finer = asked(case)
    assert finer is not None
    back = coarser_again(finer, SolverError("no convergence at 12 s"))
    assert back is not None and back.specimen == case.specimen
    assert back.specimen.refined == sized_case(case.file).specimen.refined == 0
    assert "2 and 0.667 µm could not be simulated (no convergence at 12 s)" in lines[-1]
    assert asked(back) is None
    assert lines[-1].startswith("not refined again: finer meshes could not be simulated; without ")
    (tmp_path / "results" / "sizes.json").unlink()
    assert asked(back) is not None


def test_a_failure_that_no_coarser_mesh_mends_ends_the_run(tmp_path: Path) -> None:
    case = automatic(tmp_path)
    assert coarser_again(case, SolverError("no convergence")) is None
    write_refinements(tmp_path / "results", Refinements(1, 12.5))
    assert coarser_again(sized_case(case.file), PreparedError([tmp_path])) is None
    assert coarser_again(stated(tmp_path), SolverError("no convergence")) is None


def test_nothing_is_refined_beyond_the_memory_of_the_machine(
    tmp_path: Path, lines: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(machine, "memory", lambda: 1e8)
    case = automatic(tmp_path, execution__budget_min=600.0)
    diagnosed(case)
    assert asked(case) is None and "for lack of memory" in lines[-1]
    assert to_refine(case, "mesh", 299.0).startswith("Write specimen.mesh_size_um = 2 and ")


def test_an_answer_that_stands_is_held_against_a_finer_mesh_where_that_is_asked_for(
    tmp_path: Path, lines: list[str]
) -> None:
    """One mesh alone shows a cause, or the data show more of the correction."""
    case = automatic(tmp_path, execution__budget_min=600.0)
    diagnosed(case, "nothing wrong", "mesh", passed=True)
    assert asked(case) is not None
    assert lines[-1].startswith("the answer is held against a finer mesh: 2 and 0.667 µm take ")


def test_nothing_is_refined_for_any_other_reason(tmp_path: Path) -> None:
    case = automatic(tmp_path, execution__budget_min=600.0)
    for verdict, needed in (
        ("named", None), ("numerics", "steps"), ("numerics", "mesh and steps"),
        ("unexplained", "mesh"),
    ):  # fmt: skip
        diagnosed(case, verdict, needed)
        assert asked(case) is None
    diagnosed(case)
    assert asked(case, "identify") is None
    own = stated(tmp_path, execution__budget_min=600.0)
    diagnosed(own)
    assert asked(own) is None


def test_sizes_and_budget_are_told_beforehand(tmp_path: Path) -> None:
    case = automatic(tmp_path, execution__budget_min=90.0)
    cost = estimate(case, BundledAdapter().capabilities(), 30, 4)
    told = told_beforehand(case, cost)
    assert told.startswith(
        "hex20 of 2 and 1 µm, chosen by prismid; where the mesh keeps the verdict open they are "
        "refined within execution.budget_min = 90, next 2 and 0.667 µm take about "
    )
    alone = case.with_values_at({"boundary.motion": "stage"})
    assert told_beforehand(alone, cost) == "hex20 of 2 and 1 µm, chosen by prismid"
