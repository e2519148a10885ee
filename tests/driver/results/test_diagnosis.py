from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any, get_args

import pytest

from driver.diagnosis.answer.result_types import Corrected
from tests.driver.results.datasets import section

VALUE = {"value", "sigma", "unit"}
CAUSE = {
    "cause", "category", "sentence", "parameters", "units", "statistic", "degrees", "p_family",
    "log_evidence", "estimate", "smallest_visible", "refit",
}  # fmt: skip
OMNIBUS = {
    "load_slow_p", "load_serial_p", "image_slow_p", "image_outlier_p", "together_p", "smooth_p",
    "accepted",
}  # fmt: skip
KEYS = {
    "": {
        "verdict", "causes", "sets", "text", "next", "added", "flips", "whereabouts", "gain",
        "numerics", "load_noise", "bad_loads", "not_found", "not_examined", "baseline", "extended",
        "steps", "decks", "meshes", "warnings", "travel_ratio",
        "critical_stress",
    },
    "meshes": {"cells", "mesh_size_um", "fine_mesh_size_um", "refined"},
    "whereabouts": {"text", "before", "after"},
    "gain": {
        "share_of_excess_explained", "log_bayes_factor", "budget_before", "budget_after",
        "shift_in_sigma", "held_out",
    },
    "gain.held_out": {
        "cycle", "chi_load_before", "chi_load_after", "chi_image_before", "chi_image_after",
    },
    "gain.budget_before": {"noise", "free", "model", "basis", "load"},
    "gain.budget_after": {"noise", "free", "model", "basis", "load"},
    "numerics": {
        "effect_sigma", "on", "passed", "needed", "between_meshes", "fitted_anew", "off_by_mesh",
        "missing_share", "second_mesh_um",
    },
    "travel_ratio": {"value", "sigma", "of_phases"},
    "load_noise": {"stated_uN", "found_uN", "degrees"},
    "baseline": {"values", "converged", "reason"},
    "extended": {"values", "converged", "reason"},
}  # fmt: skip


@pytest.fixture
def record(finished: Path) -> dict[str, Any]:
    read: dict[str, Any] = json.loads((finished / "diagnosis.json").read_text("utf-8"))
    return read


@pytest.mark.parametrize("place", KEYS)
def test_an_object_of_a_diagnosis_has_these_keys(place: str, record: dict[str, Any]) -> None:
    found = record
    for key in filter(None, place.split(".")):
        found = found[key]
    assert set(found) == KEYS[place]


def test_a_round_has_its_tests_and_every_cause_that_was_tried(record: dict[str, Any]) -> None:
    first, last = record["steps"]
    for step in (first, last):
        assert set(step) == {
            "chi_load", "chi_image", "widened", "omnibus", "named", "left_something", "causes",
        }  # fmt: skip
        assert set(step["omnibus"]) == OMNIBUS
        for cause in step["causes"]:
            assert set(cause) == CAUSE
            assert len(cause["parameters"]) == len(cause["units"]) == len(cause["estimate"])
    assert first["named"] == ["stretch_not_proportional"] and last["named"] == []
    assert not first["omnibus"]["accepted"] and last["omnibus"]["accepted"]
    evidence = [cause["log_evidence"] for cause in first["causes"]]
    assert evidence == sorted(evidence, reverse=True)
    refit = first["causes"][0]["refit"]
    assert set(refit) == {
        "log_evidence", "corrected", "chi_load", "chi_image", "values", "sigma",
    }  # fmt: skip
    assert refit["corrected"] in get_args(Corrected)
    assert set(refit["values"]) == set(refit["sigma"]) == {"stretch_curvature"}
    assert last["causes"][0]["refit"] is None


def test_what_was_added_stands_with_its_value_in_the_extended_model_alone(
    record: dict[str, Any],
) -> None:
    assert record["verdict"] == "named" and record["sets"] == [["stretch_not_proportional"]]
    (added,) = record["added"].items()
    assert added[0] == "stretch_curvature" and set(added[1]) == VALUE
    before, after = record["baseline"]["values"], record["extended"]["values"]
    assert set(after) - set(before) == {"stretch_curvature"}
    assert after["stretch_curvature"] == added[1]
    assert before["tau0"]["unit"] == "MPa" and before["elongation_1"]["unit"] == "µm"
    shift = (after["tau0"]["value"] - before["tau0"]["value"]) / before["tau0"]["sigma"]
    assert record["gain"]["shift_in_sigma"]["tau0"] == pytest.approx(shift)
    assert set(record["gain"]["shift_in_sigma"]) == {"tau0", "c", "d"}


def test_what_was_tried_and_not_named_says_from_which_size_it_would_have_been_seen(
    record: dict[str, Any],
) -> None:
    assert set(record["not_found"]) == {"load_gain"}
    assert record["not_found"]["load_gain"].startswith("not seen here: it would have been seen")


def test_a_solver_without_a_deck_says_why(finished: Path, record: dict[str, Any]) -> None:
    for solver, refused in record["decks"].items():
        assert (finished / "extended_decks" / solver).is_dir() == (refused is None)
    assert record["decks"]["code_aster"] is None
    assert "strain_measure" in record["decks"]["calculix"]


def test_every_key_of_a_diagnosis_is_documented() -> None:
    text = section("diagnosis.json")
    keys = {*(key for keys in KEYS.values() for key in keys), *CAUSE, *OMNIBUS}
    # A key of an object may stand behind the name of that.
    assert {key for key in keys if not re.search(rf"`(\w+\.)*{key}[`.]", text)} == set()
    assert '`{name: {"value", "sigma", "unit"}}`' in text
