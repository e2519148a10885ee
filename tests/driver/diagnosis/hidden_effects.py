"""What tests of hidden effects share: stages from files to verdict, and what is asked of it."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from driver.case.model import Case
from driver.identification.priors import FREED_WIDTH
from driver.parameters.registry import declared_parameters
from driver.virtual.truth import Course
from driver.virtual.writing import record
from driver.workflow.pipeline import run
from tools.short_specimen import small_case, true_case

Record = dict[str, Any]
Diagnose = Callable[[str, int], Record]

NULLS = {"tau0_grain2": 1.0, "boundary_shift": 0.0, "load_offset": 0.0}


def diagnoses(
    folders: pytest.TempPathFactory, known: Case, course: Callable[[str], Course]
) -> Diagnose:
    """What `diagnosis.json` says of an experiment with an effect, by its name and a seed."""

    @cache
    def diagnose(effect: str, seed: int) -> Record:
        folder: Path = folders.mktemp("experiment")
        run(record(folder, known, course(effect), seed), "diagnose", False)
        found: Record = json.loads((folder / "results" / "diagnosis.json").read_text("utf-8"))
        return found

    return diagnose


def without_prior(name: str, null: float, value: float, sigma: float) -> float:
    """The value that the data alone ask for: a refit has a Gaussian prior about the null."""
    parameter = declared_parameters(4)[name]
    theta = parameter.theta(value, null)
    share = (sigma / parameter.slope(value) / (FREED_WIDTH * parameter.width)) ** 2
    return parameter.value(theta / (1 - share), null)


def assert_named_and_recovered(found: Record, effect: str, name: str, truth: float) -> None:
    assert found["verdict"] in ("named", "one of this set")
    assert effect in found["causes"]
    before, after = found["steps"][0], found["steps"][-1]
    # Of a set the data prefer none: each of its causes was refitted, this one too.
    (cause,) = (scored for scored in before["causes"] if scored["cause"] == effect)
    value, sigma = cause["refit"]["values"][name], cause["refit"]["sigma"][name]
    assert abs(without_prior(name, NULLS[name], value, sigma) - truth) < 3 * sigma
    assert abs(value - NULLS[name]) > 5 * sigma
    assert after["omnibus"]["accepted"]
    # Images or loads, whichever showed the effect.
    assert any(after[signal] < before[signal] for signal in ("chi_load", "chi_image"))


def assert_gone(found: Record, effect: str, name: str, truth: float) -> None:
    """Nothing is found where the effect is not, though one as large would be."""
    assert found["verdict"] == "nothing wrong"
    scored = {cause["cause"]: cause for cause in found["steps"][0]["causes"]}
    (estimate,), (visible,) = scored[effect]["estimate"], scored[effect]["smallest_visible"]
    assert abs(estimate) < visible < 0.8 * abs(truth - NULLS[name])


def assert_sound(found: Record) -> None:
    """Nothing is wrong, and the law is the true one."""
    assert found["verdict"] == "nothing wrong" and found["steps"][0]["omnibus"]["accepted"]
    assert len(found["steps"][0]["causes"]) > 20
    truth = true_case(small_case())
    law = {"tau0": truth.material.tau0_MPa, "c": truth.material.c_MPa, "d": truth.material.d}
    law["lambda_plus_Y"] = truth.boundary.lambda_start.plus_Y
    for name, value in law.items():
        fitted = found["baseline"]["values"][name]
        assert abs(fitted["value"] - value) < 4 * fitted["sigma"]
