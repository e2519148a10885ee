from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import pytest

from driver.case.model import load_case
from driver.common.progress import silent
from driver.design.forecast import Forecast
from driver.design.model_discrimination import Telling, advice, apart
from driver.diagnosis.statistics.score_test import SEEN_AT
from driver.forward import build
from driver.results.files import DIAGNOSIS, RESULTS
from driver.workflow import diagnose_stage, pipeline
from driver.workflow.diagnose_stage import run_diagnose
from driver.workflow.engine import StageContext, run_stages
from solver_adapters.interface import SolverError
from tests.driver import closed_form


def expected(cosine: float, seen: dict[str, float]) -> Forecast:
    causes = [
        SimpleNamespace(
            cause=SimpleNamespace(name=name), in_scales=scales,
            cosines={other: cosine for other in seen if other != name},
        )
        for name, scales in seen.items()
    ]  # fmt: skip
    return cast(Forecast, cast(Any, SimpleNamespace(causes=causes)))


def test_causes_are_apart_by_what_one_leaves_of_the_smaller_other() -> None:
    """Two scales of each are 18 and 9 σ; of 9 σ a cosine of 0.6 leaves 7.2 σ."""
    found = apart(expected(0.6, {"a": 0.5, "b": 1.0}), {"a": 2.0, "b": 2.0})
    assert found == pytest.approx(0.8 * 2.0 * SEEN_AT)
    assert apart(expected(1.0, {"a": 0.5, "b": 1.0}), {"a": 2.0, "b": 2.0}) == 0.0


def test_the_advice_is_the_change_that_parts_them_or_that_none_does() -> None:
    now, leg, hold = Telling("", 0.3), Telling("a leg of compression", 6.2), Telling("holds", 0.4)
    assert "a leg of compression would part them best: by 6.2 σ" in advice([now, leg, hold])
    assert advice([now, hold]).startswith("None of the usual changes")


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
        run_stages(load_case(path), pipeline.stages(case), "identify", report=silent)
        results = folder / RESULTS
        yield StageContext(case, results, results, silent, False)


def told(context: StageContext) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((context.results / DIAGNOSIS).read_text("utf-8"))
    assert found["verdict"] == "one of this set"
    return found


@pytest.mark.slow
def test_a_set_of_causes_comes_with_the_measurement_that_would_part_them(
    stiffer: StageContext,
) -> None:
    run_diagnose(stiffer)
    found = told(stiffer)
    assert found["telling"][0]["change"] == "" and len(found["telling"]) > 4
    changes = [one["apart_sigma"] for one in found["telling"][1:]]
    assert changes == sorted(changes, reverse=True)
    assert "usual changes of the experiment" in found["next"]
    assert found["not_found"]["tilt_drift"].startswith("not seen here")


@pytest.mark.slow
def test_without_advice_a_set_is_the_same_and_no_changed_experiment_is_simulated(
    stiffer: StageContext, monkeypatch: pytest.MonkeyPatch
) -> None:
    run_diagnose(stiffer)
    advised = told(stiffer)
    monkeypatch.setattr(diagnose_stage, "most_telling", None)
    run_diagnose(stiffer, advise=False)
    found = told(stiffer)
    assert found["sets"] == advised["sets"] and not found["telling"]
    assert advised["next"].startswith(found["next"]) and advised["next"] != found["next"]


@pytest.mark.slow
def test_advice_that_cannot_be_simulated_costs_nothing_else(
    stiffer: StageContext, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*asked: object) -> None:
        raise SolverError("no step is short enough\nat t = 1 s")

    monkeypatch.setattr(diagnose_stage, "most_telling", fails)
    lines: list[str] = []
    run_diagnose(replace(stiffer, log=lines.append))
    assert not told(stiffer)["telling"]
    assert "  not found out: no step is short enough" in lines
