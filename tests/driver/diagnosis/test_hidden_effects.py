"""An effect is hidden in a virtual experiment; the real stages, from files to verdict, find it.

Truths are converged, where the program finds their effect, and else finer than what finds it.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from driver.case.model import Case
from driver.identification.priors import FREED_WIDTH
from driver.parameters.registry import declared_parameters
from driver.virtual.truth import Course, pull, stage_program
from driver.virtual.writing import record
from driver.workflow.pipeline import run
from tools import converged_truth
from tools.converged_truth import pulled
from tools.short_specimen import CYCLES, small_case, true_case, true_knots

Record = dict[str, Any]
Diagnose = Callable[[str, int], Record]

EFFECTS = {  # cause: parameter, null, truth
    "grain_contrast": ("tau0_grain2", 1.0, 1.25),
    "boundary_position": ("boundary_shift", 0.0, 0.6),
    "load_offset": ("load_offset", 0.0, 60.0),
}
LATENT = 14.0  # MPa, seven prior scales, where Q is 0
SLOPE = 0.65  # of ln τ₀ along grain 2, 6.3 σ of projected misfit; 0.4 are 4.3 σ and not named
CONTRAST = 1.1  # 16 σ of projected misfit
SEED = 1
OF_ONE_KIND = {
    "grain_contrast": ("tau0_grain2", EFFECTS["grain_contrast"][2]),
    "latent_hardening": ("Q_latent", LATENT),
    "heterogeneity_grain2": ("tau0_grain2_slope_Y", SLOPE),
    "nothing, of one kind": ("", 0.0),
}
"""Truths of tetrahedra, smaller than those that identify them, with parameter and value.

Their answers in converged truths are not all measured (benchmarks/diagnosis.md): the error of the
meshes grows with the effect.
"""


def moved_boundary(truth: Case) -> Case:
    """The boundary not moved by a parameter, but drawn elsewhere and meshed there."""
    point = truth.specimen.boundary_point_um
    assert point is not None
    by = EFFECTS["boundary_position"][2]
    moved = {"boundary_point_um": (point[0], point[1] + by, point[2])}
    return truth.model_copy(update={"specimen": truth.specimen.model_copy(update=moved)})


def known(effect: str) -> Case:
    """What the user of an experiment knows, on cells that do not make its truth if it converged."""
    return small_case() if effect in OF_ONE_KIND else converged_truth.known_case()


@cache
def course(effect: str) -> Course:
    if effect in OF_ONE_KIND:
        name, value = OF_ONE_KIND[effect]
        history = stage_program(CYCLES)
        hidden = {name: value} if name else {}
        return pull(true_case(small_case()), history, {**true_knots(history), **hidden})
    if effect == "load_offset":
        unbiased = course("nothing")
        return replace(unbiased, load=unbiased.load + EFFECTS[effect][2])
    if effect == "contrast, converged":
        return pulled({"tau0_grain2": CONTRAST})
    if effect == "boundary_position":
        return pulled({}, truth=moved_boundary(converged_truth.true_case()))
    return pulled({})


@pytest.fixture(scope="module")
def diagnosed(tmp_path_factory: pytest.TempPathFactory) -> Diagnose:
    """What `diagnosis.json` says of an experiment with an effect, by its name and a seed."""

    @cache
    def diagnose(effect: str, seed: int) -> Record:
        folder: Path = tmp_path_factory.mktemp("experiment")
        case = record(folder, known(effect), course(effect), seed)
        run(case, "diagnose", False)
        found: Record = json.loads((folder / "results" / "diagnosis.json").read_text("utf-8"))
        return found

    return diagnose


def without_prior(name: str, null: float, value: float, sigma: float) -> float:
    """The value that the data alone ask for: a refit has a Gaussian prior about the null."""
    parameter = declared_parameters(4)[name]
    theta = parameter.theta(value, null)
    share = (sigma / parameter.slope(value) / (FREED_WIDTH * parameter.width)) ** 2
    return parameter.value(theta / (1 - share), null)


@pytest.mark.parametrize("effect", EFFECTS)
def test_a_hidden_effect_is_named_and_its_size_recovered(effect: str, diagnosed: Diagnose) -> None:
    found = diagnosed(effect, SEED)
    assert found["verdict"] in ("named", "one of this set")
    assert effect in found["causes"]
    before, after = found["steps"][0], found["steps"][-1]
    name, null, truth = EFFECTS[effect]
    # Of a set the data prefer none: each of its causes was refitted, this one too.
    (cause,) = (scored for scored in before["causes"] if scored["cause"] == effect)
    value, sigma = cause["refit"]["values"][name], cause["refit"]["sigma"][name]
    assert abs(without_prior(name, null, value, sigma) - truth) < 3 * sigma
    assert abs(value - null) > 5 * sigma
    assert after["omnibus"]["accepted"]
    # Images or loads, whichever showed the effect.
    assert any(after[signal] < before[signal] for signal in ("chi_load", "chi_image"))


@pytest.mark.slow
def test_latent_hardening_is_named_where_there_is_no_isotropic_hardening(
    diagnosed: Diagnose,
) -> None:
    """Its size is hardly known beside b, c and d: four σ, and the prior draws it to its null."""
    found = diagnosed("latent_hardening", SEED)
    assert found["verdict"] in ("named", "one of this set")
    assert "latent_hardening" in found["causes"]
    scored = {cause["cause"]: cause for cause in found["steps"][0]["causes"]}
    refit = scored["latent_hardening"]["refit"]
    value, sigma = refit["values"]["Q_latent"], refit["sigma"]["Q_latent"]
    assert abs(without_prior("Q_latent", 0.0, value, sigma) - LATENT) < 3 * sigma
    assert refit["log_evidence"] > 10


@pytest.mark.slow
def test_a_critical_stress_that_varies_inside_a_grain_is_named_and_its_slope_recovered(
    diagnosed: Diagnose,
) -> None:
    found = diagnosed("heterogeneity_grain2", SEED)
    assert found["verdict"] in ("named", "one of this set")
    assert "heterogeneity_grain2" in found["causes"]
    before, after = found["steps"][0], found["steps"][-1]
    scored = {cause["cause"]: cause for cause in before["causes"]}
    refit = scored["heterogeneity_grain2"]["refit"]
    value, sigma = refit["values"]["tau0_grain2_slope_Y"], refit["sigma"]["tau0_grain2_slope_Y"]
    assert abs(without_prior("tau0_grain2_slope_Y", 0.0, value, sigma) - SLOPE) < 3 * sigma
    assert refit["log_evidence"] > scored["grain_contrast"]["refit"]["log_evidence"] + 3
    assert after["omnibus"]["accepted"] and after["chi_load"] < before["chi_load"]


@pytest.mark.parametrize("effect", EFFECTS)
def test_without_the_effect_the_finding_is_gone(effect: str, diagnosed: Diagnose) -> None:
    """The same relief, stage errors and noise; only the effect is taken out."""
    found = diagnosed("nothing, of one kind" if effect in OF_ONE_KIND else "nothing", SEED)
    assert found["verdict"] == "nothing wrong"
    scored = {cause["cause"]: cause for cause in found["steps"][0]["causes"]}
    (estimate,), (visible,) = scored[effect]["estimate"], scored[effect]["smallest_visible"]
    _, null, truth = EFFECTS[effect]
    assert abs(estimate) < visible < 0.8 * abs(truth - null)


def test_a_sound_model_gets_nothing_wrong_and_the_true_law(diagnosed: Diagnose) -> None:
    for kind, seed in (("nothing", SEED), ("nothing", SEED + 1), ("nothing, of one kind", SEED)):
        found = diagnosed(kind, seed)
        assert found["verdict"] == "nothing wrong" and found["steps"][0]["omnibus"]["accepted"]
        assert len(found["steps"][0]["causes"]) > 20
        truth = true_case(small_case())
        law = {"tau0": truth.material.tau0_MPa, "c": truth.material.c_MPa, "d": truth.material.d}
        law["lambda_plus_Y"] = truth.boundary.lambda_start.plus_Y
        for name, value in law.items():
            fitted = found["baseline"]["values"][name]
            assert abs(fitted["value"] - value) < 4 * fitted["sigma"]


@pytest.mark.slow
def test_a_contrast_in_a_converged_truth_is_answered_and_its_size_recovered(
    diagnosed: Diagnose,
) -> None:
    """Corrected once, the refits answered twinning asymmetry and the {112} family alone."""
    found = diagnosed("contrast, converged", SEED)
    assert found["verdict"] in ("named", "one of this set")
    assert "grain_contrast" in found["causes"]
    ratio = found["extended"]["values"]["tau0_grain2"]
    assert abs(ratio["value"] - CONTRAST) < 3 * ratio["sigma"] < 0.06
    assert found["steps"][-1]["omnibus"]["accepted"]
