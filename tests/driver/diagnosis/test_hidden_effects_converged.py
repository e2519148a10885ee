"""An effect is hidden in a converged truth; the real stages, from files to verdict, find it.

The truth is of two kinds of cells, each extrapolated to cells of no size; what the effect changes
is extrapolated as well, from hexahedra of 0.667 and 0.5 µm, but that of a soft slice, which ends
where cells of 0.5 µm do. On hexahedra of 2 and 1 µm an effect is found, but where nothing is hidden
the mesh keeps the verdict open; 0.667 µm leave nothing wrong.
"""

from __future__ import annotations

from functools import cache

import pytest

from driver.case.model import Case
from driver.experiment.history import History
from driver.virtual.truth import Course
from solver_adapters.interface import Simulation
from tests.driver.diagnosis.hidden_effects import (
    Diagnose,
    assert_gone,
    assert_named_and_recovered,
    assert_sound,
    diagnoses,
)
from tools.beyond_parameters import SLICE, blistered, with_soft_slice
from tools.converged_truth import known_case, pulled, true_case

EFFECTS = {  # cause: parameter and truth
    "grain_contrast": ("tau0_grain2", 1.25),
    "boundary_position": ("boundary_shift", 0.6),
}
SOFT = 0.7  # τ0 of the slice over that of the rest of grain 2
BLISTER = 0.04  # height at the end of the test [µm]
SEED = 1


def moved_boundary(truth: Case) -> Case:
    """The boundary not moved by a parameter, but drawn elsewhere and meshed there."""
    point = truth.specimen.boundary_point_um
    assert point is not None
    x, y, z = point
    moved = (x, y + EFFECTS["boundary_position"][1], z)
    return truth.with_values_at({"specimen.boundary_point_um": moved})


def softened(simulation: Simulation, history: History) -> Simulation:
    return with_soft_slice(simulation, SOFT)


@cache
def course(effect: str) -> Course:
    if effect == "grain_contrast":
        name, value = EFFECTS[effect]
        return pulled({name: value})
    if effect == "boundary_position":
        return pulled({}, truth=moved_boundary(true_case()))
    if effect == "soft_slice":
        return pulled({}, change=softened, sizes=(0.5,))
    bare = pulled({})
    return blistered(bare, BLISTER) if effect == "blister" else bare


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> Diagnose:
    """On hexahedra of 2 and 1 µm."""
    coarser = known_case().with_values_at({"specimen.fine_mesh_size_um": 1.0})
    return diagnoses(tmp_path_factory, coarser, course)


@pytest.fixture(scope="module")
def diagnosed(tmp_path_factory: pytest.TempPathFactory) -> Diagnose:
    """On hexahedra of 2 and 0.667 µm."""
    return diagnoses(tmp_path_factory, known_case(), course)


@pytest.mark.parametrize(
    "effect",
    [
        pytest.param(effect, marks=pytest.mark.slow if k == 0 else pytest.mark.long)
        for k, effect in enumerate(EFFECTS)
    ],
)
def test_an_effect_in_a_converged_truth_is_answered_and_its_size_recovered(
    effect: str, found: Diagnose
) -> None:
    """Under a constant correction a contrast was found too large by four standard deviations."""
    assert_named_and_recovered(found(effect, SEED), effect, *EFFECTS[effect])


@pytest.mark.long
def test_a_soft_slice_is_named_a_band_across_its_grain_with_its_place_its_width_and_its_stress(
    found: Diagnose,
) -> None:
    """Without a cause for it a contrast of the grains was named, with a wrong size."""
    answer = found("soft_slice", SEED)
    assert answer["verdict"] == "named" and answer["causes"] == ["band_grain2"]
    assert not answer["steps"][0]["omnibus"]["accepted"]
    assert answer["steps"][-1]["omnibus"]["accepted"]
    (along,) = answer["critical_stress"]
    first, last = (share * known_case().specimen.length for share in SLICE)
    truth = {"ratio": SOFT, "middle_um": 0.5 * (first + last), "width_um": last - first}
    for what, true in truth.items():
        value, sigma = along["band"][what]
        assert abs(value - true) < 3 * sigma < true, what


@pytest.mark.long
def test_what_no_cause_describes_is_unexplained_in_a_converged_truth(found: Diagnose) -> None:
    """Dirt that grows on the face bends the model, whose own error was blamed for what is left."""
    answer = found("blister", SEED)
    assert answer["verdict"] == "unexplained"
    assert not answer["steps"][-1]["omnibus"]["accepted"]
    assert answer["steps"][-1]["omnibus"]["image_slow_p"] < 1e-20


@pytest.mark.long
@pytest.mark.parametrize("effect", EFFECTS)
def test_without_the_effect_the_finding_is_gone(effect: str, diagnosed: Diagnose) -> None:
    """The same relief, stage errors and noise; only the effect is taken out."""
    assert_gone(diagnosed("nothing", SEED), effect, *EFFECTS[effect])


@pytest.mark.long
def test_a_sound_model_gets_nothing_wrong_in_a_converged_truth_and_the_true_law(
    diagnosed: Diagnose,
) -> None:
    """How often it does is for the blind trial to measure (benchmarks/diagnosis.md)."""
    assert_sound(diagnosed("nothing", SEED))
