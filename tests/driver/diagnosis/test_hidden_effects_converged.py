"""An effect is hidden in a converged truth; the real stages, from files to verdict, find it.

The truth is of two kinds of cells, each extrapolated to cells of no size; what the effect changes
is extrapolated as well, from hexahedra of 0.667 and 0.5 µm. On hexahedra of 2 and 1 µm an effect is
found, but where nothing is hidden the mesh keeps the verdict open; 0.667 µm leave nothing wrong.
"""

from __future__ import annotations

from functools import cache

import pytest

from driver.case.model import Case
from driver.virtual.truth import Course
from tests.driver.diagnosis.hidden_effects import (
    Diagnose,
    assert_gone,
    assert_named_and_recovered,
    assert_sound,
    diagnoses,
)
from tools.converged_truth import known_case, pulled, true_case

pytestmark = pytest.mark.slow

EFFECTS = {  # cause: parameter and truth
    "grain_contrast": ("tau0_grain2", 1.25),
    "boundary_position": ("boundary_shift", 0.6),
}
SEED = 1


def moved_boundary(truth: Case) -> Case:
    """The boundary not moved by a parameter, but drawn elsewhere and meshed there."""
    point = truth.specimen.boundary_point_um
    assert point is not None
    x, y, z = point
    moved = (x, y + EFFECTS["boundary_position"][1], z)
    return truth.with_values_at({"specimen.boundary_point_um": moved})


@cache
def course(effect: str) -> Course:
    if effect == "grain_contrast":
        name, value = EFFECTS[effect]
        return pulled({name: value})
    if effect == "boundary_position":
        return pulled({}, truth=moved_boundary(true_case()))
    return pulled({})


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> Diagnose:
    """On hexahedra of 2 and 1 µm."""
    coarser = known_case().with_values_at({"specimen.fine_mesh_size_um": 1.0})
    return diagnoses(tmp_path_factory, coarser, course)


@pytest.fixture(scope="module")
def diagnosed(tmp_path_factory: pytest.TempPathFactory) -> Diagnose:
    """On hexahedra of 2 and 0.667 µm."""
    return diagnoses(tmp_path_factory, known_case(), course)


@pytest.mark.parametrize("effect", EFFECTS)
def test_an_effect_in_a_converged_truth_is_answered_and_its_size_recovered(
    effect: str, found: Diagnose
) -> None:
    """Under a constant correction a contrast was found too large by four standard deviations."""
    assert_named_and_recovered(found(effect, SEED), effect, *EFFECTS[effect])


@pytest.mark.parametrize("effect", EFFECTS)
def test_without_the_effect_the_finding_is_gone(effect: str, diagnosed: Diagnose) -> None:
    """The same relief, stage errors and noise; only the effect is taken out."""
    assert_gone(diagnosed("nothing", SEED), effect, *EFFECTS[effect])


def test_a_sound_model_gets_nothing_wrong_in_a_converged_truth_and_the_true_law(
    diagnosed: Diagnose,
) -> None:
    """How often it does is for the blind trial to measure (benchmarks/diagnosis.md)."""
    assert_sound(diagnosed("nothing", SEED))
