from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from driver.case.model import load_case
from driver.forward import build
from driver.results.files import ADVICE, DIAGNOSIS, RESULTS
from driver.workflow import advise_stage, pipeline
from driver.workflow.advise_stage import run_advise
from driver.workflow.diagnose_stage import run_diagnose
from driver.workflow.engine import StageContext, run_stages
from solver_adapters.interface import SolverError
from solver_adapters.jobs.errors import CommandMissingError
from solver_adapters.jobs.status import Status
from tools import closed_form


@pytest.fixture(scope="module")
def stiffer(tmp_path_factory: pytest.TempPathFactory) -> Iterator[StageContext]:
    """A specimen of a stiffer crystal, identified without that."""
    folder = tmp_path_factory.mktemp("stiffer")
    with pytest.MonkeyPatch.context() as patch:
        solver = closed_form.ClosedFormSolver(0.001)
        patch.setattr(build, "find_adapter", lambda name, profile: solver)
        closed_form.write_files(folder, {"elastic_scale": 1.2})
        path = folder / "case.toml"
        case = load_case(path)
        run_stages(load_case(path), pipeline.stages(case), "identify")
        results = folder / RESULTS
        yield StageContext(case, results, results, False)


def answer(context: StageContext, name: str) -> dict[str, Any]:
    record: dict[str, Any] = json.loads((context.results / name).read_text("utf-8"))
    return record


@pytest.fixture(scope="module")
def diagnosed(stiffer: StageContext) -> StageContext:
    run_diagnose(stiffer)
    assert answer(stiffer, DIAGNOSIS)["verdict"] == "one of this set"
    return stiffer


@pytest.mark.slow
def test_a_set_of_causes_comes_with_the_measurement_that_would_part_them(
    diagnosed: StageContext,
) -> None:
    run_advise(diagnosed)
    advised, diagnosis = answer(diagnosed, ADVICE), answer(diagnosed, DIAGNOSIS)
    assert advised["causes"] in diagnosis["sets"]
    assert advised["changes"][0]["change"] == "" and len(advised["changes"]) > 4
    apart = [one["apart_sigma"] for one in advised["changes"][1:]]
    assert apart == sorted(apart, reverse=True)
    assert "usual changes of the experiment" in advised["text"]
    assert diagnosis["not_found"]["tilt_drift"].startswith("not seen here")


@pytest.mark.slow
def test_advice_that_cannot_be_simulated_is_told_and_ends_nothing(
    diagnosed: StageContext, monkeypatch: pytest.MonkeyPatch, lines: list[str]
) -> None:
    def fails(*asked: object) -> None:
        raise SolverError("no step is short enough\nat t = 1 s")

    monkeypatch.setattr(advise_stage, "discriminating_changes", fails)
    run_advise(diagnosed)
    advised = answer(diagnosed, ADVICE)
    assert advised["causes"] and not advised["changes"] and not advised["text"]
    assert "  not found out: no step is short enough" in lines


@pytest.mark.slow
@pytest.mark.parametrize("reason", ["absent", "prepared"])
def test_a_program_on_another_machine_keeps_no_report_from_being_made(
    diagnosed: StageContext, monkeypatch: pytest.MonkeyPatch, reason: str, lines: list[str]
) -> None:
    def absent(*asked: object) -> None:
        raise CommandMissingError(
            "code_aster", Status.COMMAND_MISSING, "found no run_aster on PATH"
        )

    monkeypatch.setattr(advise_stage, "discriminating_changes", absent)
    run_advise(replace(diagnosed, prepare_only=reason == "prepared"))
    assert answer(diagnosed, ADVICE)["changes"] == []
    assert any(line.startswith("  not found out: ") for line in lines)


@pytest.mark.parametrize("verdict", ["named", "nothing wrong", "unexplained"])
def test_where_no_set_is_left_no_change_is_simulated(
    tmp_path: Path, verdict: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    sets = [["load_gain", "elastic_stiffness"]]
    (tmp_path / DIAGNOSIS).write_text(json.dumps({"verdict": verdict, "sets": sets}), "utf-8")
    monkeypatch.setattr(advise_stage, "discriminating_changes", None)
    context = StageContext(closed_form.small_case(), tmp_path, tmp_path)
    run_advise(context)
    assert answer(context, ADVICE) == {"causes": [], "changes": [], "text": ""}
