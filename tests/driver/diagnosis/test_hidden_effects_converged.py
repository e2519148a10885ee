"""An effect is hidden in a converged truth; the real stages, from files to verdict, find it.

The truth is of two kinds of cells, each extrapolated to cells of no size; what the effect changes
is extrapolated as well, from hexahedra of other sizes than those that find it but one.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
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
from tools.converged_truth import known_case, pulled, true_case

pytestmark = pytest.mark.slow

EFFECTS = {  # cause: parameter and truth
    "grain_contrast": ("tau0_grain2", 1.25),
    "boundary_position": ("boundary_shift", 0.6),
}
SLICE = 0.55  # of τ₀ in 1.6 µm of grain 2
SEED = 1


def moved_boundary(truth: Case) -> Case:
    """The boundary not moved by a parameter, but drawn elsewhere and meshed there."""
    point = truth.specimen.boundary_point_um
    assert point is not None
    x, y, z = point
    moved = (x, y + EFFECTS["boundary_position"][1], z)
    return truth.with_values_at({"specimen.boundary_point_um": moved})


def sliced(simulation: Simulation, history: History) -> Simulation:
    """A slice of grain 2 yields early: a third grain with the lattice of the second."""
    mesh, turned = simulation.mesh, simulation.orientations
    middle = mesh.points[mesh.cells, 1].mean(axis=1)
    inside = (mesh.grain == 1) & (middle > 4.8) & (middle < 6.4)
    return replace(
        simulation,
        mesh=replace(mesh, grain=np.where(inside, 2, mesh.grain)),
        orientations=np.concatenate([turned, turned[1:]]),
        material=replace(simulation.material, tau0_grains=(SLICE,)),
    )


@cache
def course(effect: str) -> Course:
    if effect == "grain_contrast":
        name, value = EFFECTS[effect]
        return pulled({name: value})
    if effect == "boundary_position":
        return pulled({}, truth=moved_boundary(true_case()))
    if effect == "soft slice":
        return pulled({}, change=sliced)
    return pulled({})


@pytest.fixture(scope="module")
def diagnosed(tmp_path_factory: pytest.TempPathFactory) -> Diagnose:
    return diagnoses(tmp_path_factory, known_case(), course)


@pytest.mark.parametrize("effect", EFFECTS)
def test_an_effect_in_a_converged_truth_is_answered_and_its_size_recovered(
    effect: str, diagnosed: Diagnose
) -> None:
    """Under a constant correction a contrast was found too large by four standard deviations."""
    assert_named_and_recovered(diagnosed(effect, SEED), effect, *EFFECTS[effect])


@pytest.mark.parametrize("effect", EFFECTS)
def test_without_the_effect_the_finding_is_gone(effect: str, diagnosed: Diagnose) -> None:
    """The same relief, stage errors and noise; only the effect is taken out."""
    assert_gone(diagnosed("nothing", SEED), effect, *EFFECTS[effect])


@pytest.mark.parametrize("seed", [SEED, SEED + 1])
def test_a_sound_model_gets_nothing_wrong_in_a_converged_truth_and_the_true_law(
    seed: int, diagnosed: Diagnose
) -> None:
    assert_sound(diagnosed("nothing", seed))


def test_a_soft_slice_of_a_grain_is_heterogeneity_and_no_contrast_alone(
    diagnosed: Diagnose,
) -> None:
    """The slice lowers the mean of its grain as well, which the modes do not hold."""
    found = diagnosed("soft slice", SEED)
    assert found["verdict"] != "nothing wrong"
    assert found["causes"] != ["grain_contrast"]
    scored = {cause["cause"]: cause for cause in found["steps"][0]["causes"]}
    refit, contrast = (scored[n]["refit"] for n in ("heterogeneity_grain2", "grain_contrast"))
    assert refit["log_evidence"] > contrast["log_evidence"]
    assert refit["values"]["tau0_grain2"] < 1 - 2 * refit["sigma"]["tau0_grain2"]
