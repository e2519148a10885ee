from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from driver.diagnosis.causes.causes import LIBRARY
from driver.diagnosis.statistics.score_test import PARALLEL, SEEN_AT
from driver.results.design import (
    Design,
    Gain,
    Knowledge,
    Outlook,
    PlannedExperiment,
    Visible,
    write_design,
)

KNOWN = Knowledge(
    name="tau0", value=40.0, unit="MPa", relative=True, sigma=np.inf, theta=np.inf, prior=1.0,
    alone=0.01, parts={"images": 0.25, "loads": 0.75}, partner="c", factor=0.5, limit="the loads",
)  # fmt: skip
SEEN = Visible(
    name="load_gain", unit="", relative=False, scale=0.02, sigma=0.001, seen=0.003, named=np.inf,
    left=0.1, loads=1.0, hidden_by="c", factor=0.4,
)  # fmt: skip
GAIN = next(cause for cause in LIBRARY if cause.name == "load_gain")
OUTLOOK = Outlook(GAIN, (SEEN,), {"elastic_scale": 0.999, "load_drift": 0.3})


def planned(name: str, change: str) -> PlannedExperiment:
    return PlannedExperiment(
        name, change, 17, 640.0, np.array([0.0, 0.02]), np.array([0.0, 300.0]), (KNOWN,), (OUTLOOK,)
    )


@pytest.fixture
def record(tmp_path: Path) -> dict[str, Any]:
    gain = Gain({"tau0": 0.5, "c": np.inf}, {"load_gain": 0.25}, (("a", "b"),), (), ("load_gain",),
                ("c",))  # fmt: skip
    changed = planned("quiet", "loads.noise_uN=2")
    design = Design("repeats", 0.003, 6.0, 6.5, planned("the case", ""), ((changed, gain),))
    write_design(tmp_path, design)
    read: dict[str, Any] = json.loads((tmp_path / "design.json").read_text("utf-8"))
    return read


def test_an_experiment_stands_in_nanometres_micronewtons_and_seconds(
    record: dict[str, Any],
) -> None:
    experiment = record["experiment"]
    del experiment["parameters"], experiment["causes"]
    assert experiment == {
        "name": "the case", "change": "", "n_images": 17, "duration_s": 640.0,
        "elongation_nm": [0.0, 20.0], "load_uN": [0.0, 300.0],
    }  # fmt: skip
    del record["experiment"], record["changes"], record["prismid"]
    assert record == {
        "surface": "repeats", "noise_nm": 3.0, "load_noise_uN": 6.0,
        "seen_at_sigma": SEEN_AT, "named_at_sigma": 6.5,
        "parallel_cosine": PARALLEL,
    }  # fmt: skip


def test_what_is_infinite_is_null_in_parameters_causes_and_gains(
    record: dict[str, Any],
) -> None:
    (changed,) = record["changes"]
    assert changed["parameters"] == [
        {
            "parameter": "tau0", "assumed": 40.0, "unit": "MPa", "sigma": None,
            "sigma_theta": None, "prior_theta": 1.0, "alone_theta": 0.01,
            "variance_from": {"images": 0.25, "loads": 0.75}, "correlated_with": "c",
            "factor_if_known": 0.5, "limited_by": "the loads",
        }
    ]  # fmt: skip
    assert changed["causes"] == [
        {
            "cause": "load_gain", "category": GAIN.category, "sentence": GAIN.sentence,
            "parameters": [
                {
                    "parameter": "load_gain", "unit": "", "relative": False, "scale": 0.02,
                    "sigma": 0.001, "smallest_seen": 0.003, "smallest_named": None, "left": 0.1,
                    "in_loads": 1.0, "hidden_by": "c", "factor_if_known": 0.4,
                }
            ],
            "cosines": {"elastic_scale": 0.999, "load_drift": 0.3},
            "not_told_from": ["elastic_scale"],
        }
    ]  # fmt: skip
    assert changed["gain"] == {
        "sigma_ratio": {"tau0": 0.5, "c": None}, "seen_ratio": {"load_gain": 0.25},
        "parted": [["a", "b"]], "merged": [], "shown": ["load_gain"], "lost": ["c"],
    }  # fmt: skip


def test_the_best_visible_parameter_of_a_cause_tells_how_large_it_has_to_be() -> None:
    hidden = Visible("Q", "MPa", False, 10.0, 5.0, 20.0, 40.0, 0.1, 0.5, "b", 0.9)
    assert hidden.in_scales == 2.0
    assert Outlook(GAIN, (hidden, SEEN), {}).in_scales == pytest.approx(0.15)
