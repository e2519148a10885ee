"""An effect is hidden in a virtual experiment; the real stages, from files to verdict, find it.

Truths are of tetrahedra, smaller than those that find the effect: quick, and no judge of the mesh.
Those of `test_hidden_effects_converged` are; there, a contrast and a moved boundary are hidden.
"""

from __future__ import annotations

from functools import cache

import pytest

from driver.virtual.truth import Course, pull, stage_program
from tests.driver.diagnosis.hidden_effects import (
    Diagnose,
    assert_gone,
    assert_named_and_recovered,
    assert_sound,
    diagnoses,
    without_prior,
)
from tools.short_specimen import CYCLES, small_case, true_case, true_knots

OFFSET = 60.0  # µN
LATENT = 14.0  # MPa, seven prior scales, where Q is 0
SEED = 1
EFFECTS = {  # cause: parameter and truth
    "latent_hardening": ("Q_latent", LATENT),
    "load_offset": ("load_offset", OFFSET),
    "nothing": ("", 0.0),
}


@cache
def course(effect: str) -> Course:
    name, value = EFFECTS[effect]
    history = stage_program(CYCLES)
    hidden = {name: value} if name else {}
    return pull(true_case(small_case()), history, {**true_knots(history), **hidden})


@pytest.fixture(scope="module")
def diagnosed(tmp_path_factory: pytest.TempPathFactory) -> Diagnose:
    return diagnoses(tmp_path_factory, small_case(), course)


@pytest.mark.slow
def test_a_hidden_effect_is_named_and_its_size_recovered(diagnosed: Diagnose) -> None:
    found = diagnosed("load_offset", SEED)
    assert_named_and_recovered(found, "load_offset", *EFFECTS["load_offset"])


@pytest.mark.long
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
def test_without_the_effect_the_finding_is_gone(diagnosed: Diagnose) -> None:
    """The same relief, stage errors and noise; only the effect is taken out."""
    assert_gone(diagnosed("nothing", SEED), "load_offset", *EFFECTS["load_offset"])


@pytest.mark.slow
def test_a_sound_model_gets_nothing_wrong_and_the_true_law(diagnosed: Diagnose) -> None:
    assert_sound(diagnosed("nothing", SEED))
