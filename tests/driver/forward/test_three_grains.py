"""A bar of three grains in the forward model: its parameters by number, and their derivatives."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from driver.diagnosis.causes.grain_causes import library
from driver.diagnosis.statistics.screening import screened
from driver.forward.build import adapter_of, build_model, mesh_of
from driver.forward.model import ForwardModel
from driver.virtual.truth import stage_program
from meshes.arrays import FloatArray
from solver_adapters.bundled.adapter import BundledAdapter
from solver_adapters.grain_scalars import inside_names
from solver_adapters.interface import Capabilities
from tools.three_grains import three_grains

STEPS = {
    "tau0_grain3": 1e-3,
    "tau0_grain3_slope_Y": 1e-3,
    "tau0_grain3_band": 1e-3,
    "rotation_grain3_x": 1e-4,
    "lattice_gradient_grain3_z": 1e-5,
    "boundary1_tilt_x": 1e-3,
    "boundary2_shift": 1e-3,
    "boundary2_bow": 1e-3,
}


@cache
def model() -> ForwardModel:
    case = three_grains(material={"strain_measure": "small", "tau0_grains": [1.2]})
    pixels = np.stack(np.meshgrid([-1.5, 0.0, 1.5], [2.0, 6.0, 10.0]), axis=-1).reshape(-1, 2)
    mesh, history = mesh_of(case, 3.0), stage_program([(2, 1)])
    return build_model(case, mesh, history, pixels, adapter_of(case), 1)


def values(**changes: float) -> dict[str, float]:
    elongations = {"elongation_1": 0.05, "elongation_2": 0.04}
    return model().null_values() | elongations | changes


def observed(**changes: float) -> tuple[FloatArray, FloatArray]:
    seen = model().predict(values(**changes))
    return seen.load, seen.surface


@cache
def derivatives() -> tuple[FloatArray, FloatArray]:
    seen = model().predict(values(), tuple(STEPS))
    return seen.d_load, seen.d_surface


@pytest.mark.parametrize("name", STEPS)
def test_what_is_seen_changes_with_a_numbered_parameter_as_its_derivative_says(name: str) -> None:
    null, step = values()[name], STEPS[name]
    (load, surface), (load_0, surface_0) = (observed(**{name: null + s}) for s in (step, -step))
    row = list(STEPS).index(name)
    d_load, d_surface = (found[row] for found in derivatives())
    for found, change in ((d_load, load - load_0), (d_surface, surface - surface_0)):
        expected = change / (2 * step)
        assert abs(expected).max() > 0
        np.testing.assert_allclose(found, expected, rtol=0, atol=2e-3 * abs(expected).max())


def test_a_solver_that_lacks_what_varies_inside_grains_has_no_cause_of_it_in_any_grain() -> None:
    class Uniform(BundledAdapter):
        """The solver, without modes and bands."""

        def capabilities(self) -> Capabilities:
            known = super().capabilities()
            inside = {*inside_names(1), *inside_names(2)}
            return replace(known, material=known.material - inside)

    candidates, names = screened(replace(model(), adapter=Uniform()), ("tau0", "c", "d"), None)
    named = " ".join([*names, *(cause.name for cause in candidates)])
    assert "grain3_contrast" in named
    assert not re.search("slope|bend_Y|band|heterogeneity", named)


def test_the_specimen_has_every_cause_of_three_grains_that_copper_has() -> None:
    candidates, names = screened(model(), ("tau0", "c", "d"), None)
    left = {cause.name for cause in library(3)} - {cause.name for cause in candidates}
    of_bcc = {"twinning_asymmetry", "non_schmid", "family_112", "family_123"}
    assert left == of_bcc | {"fixed_pattern"}
    assert {"tau0_grain3", "tau0_grain3_band_middle", "rotation_grain3_y", "boundary2_bow"} < set(
        names
    )
    assert model().null_values()["tau0_grain3"] == 1.2
