"""Critical stress along the grains in which a fit has freed it."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np

from driver.diagnosis.answer.stress_along_grains import StressAlongGrain, stress_along_grains
from driver.identification.fit import Fit
from meshes.prism_mesh import PrismMesh
from solver_adapters.material import Material, declarations_at, scalar
from tools.boxes import BOXES

PARAMETERS = {one.name: one for one in declarations_at(Material(), 3)}
MESH = BOXES["tet10"]((2, 4, 2), (2.0, 4.0, 3.0), 0.0)
"""Grains of 2 µm along Y each."""


def along(
    values: dict[str, float], sigma: float = 0.1, mesh: PrismMesh = MESH
) -> tuple[StressAlongGrain, ...]:
    """Of a fit with these parameters free, each θ of them known to the same standard deviation."""
    every = {name: scalar(Material(), name) for name in PARAMETERS} | values
    best = SimpleNamespace(free=("tau0", *values))
    covariance = sigma**2 * np.eye(1 + len(values))
    fitted = SimpleNamespace(best=best, values=every, covariance=covariance)
    return stress_along_grains(mesh, cast(Fit, fitted), PARAMETERS)


def test_a_fit_without_modes_and_bands_has_none() -> None:
    assert along({}) == along({"tau0_112": 1.1}) == along({"tau0_grain1_slope_X": 0.1}) == ()


def test_a_slope_is_exponential_along_its_grain_and_known_best_in_the_middle() -> None:
    (grain,) = along({"tau0_grain2_slope_Y": 0.3})
    eta = grain.y - 3.0
    assert grain.grain == 2 and grain.band is None
    assert eta[0] == -1.0 and eta[-1] == 1.0
    np.testing.assert_allclose(grain.ratio, np.exp(0.3 * eta), rtol=1e-12)
    # One prior scale of the slope is 0.1.
    np.testing.assert_allclose(grain.sigma, 0.01 * abs(eta) * grain.ratio, atol=1e-15)
    assert grain.sentence() == (
        "Along grain 2 the critical stress lies between 0.741 ± 0.007 (at Y = 2.00 µm) and "
        "1.350 ± 0.013 (at Y = 4.00 µm) times that without modes and band, in the middle of the "
        "width."
    )


def test_a_band_is_told_in_micrometres_with_the_uncertainty_of_its_parameters() -> None:
    (grain,) = along(
        {
            "tau0_grain1_band": -0.4,
            "tau0_grain1_band_middle": 0.5,
            "tau0_grain1_band_half_width": 0.2,
        }
    )
    assert grain.grain == 1 and grain.band is not None
    middle = int(np.argmin(grain.ratio))
    assert abs(grain.y[middle] - 1.5) < 0.02
    np.testing.assert_allclose(grain.ratio[middle], np.exp(-0.4), rtol=1e-6)
    edge = np.interp(1.7, grain.y, np.log(grain.ratio))
    np.testing.assert_allclose(edge, -0.2, atol=2e-3)
    np.testing.assert_allclose(grain.band.ratio, np.exp(-0.4) * np.array([1.0, 0.01]))
    # Of its middle a prior scale is 0.5 along half of the grain, of its width e^0.5.
    np.testing.assert_allclose(grain.band.middle, [1.5, 0.05])
    np.testing.assert_allclose(grain.band.width, [0.4, 0.4 * 0.05 * 2])
    assert grain.sentence() == (
        "The band in grain 1 has 0.670 ± 0.007 times the critical stress that the grain would have "
        "there without it, its middle lies at Y = 1.50 ± 0.05 µm, and it is 0.40 ± 0.04 µm wide."
    )


def test_in_a_wedge_the_middle_of_a_band_is_the_mean_of_its_volume() -> None:
    """Of a grain whose height falls to nothing over L it lies L/3 from the thick end."""
    wedge = MESH.points * np.column_stack(
        [np.ones(len(MESH.points))] * 2 + [1.0 - 0.5 * MESH.points[:, 1] / 2.0]
    )
    (grain,) = along({"tau0_grain2_band": -0.4}, mesh=replace(MESH, points=wedge))
    assert grain.band is not None
    np.testing.assert_allclose(grain.band.middle[0], 2.0 + 2.0 / 3.0, rtol=2e-3)


def test_a_band_across_a_third_grain_lies_in_that_grain() -> None:
    lengths = np.array([1.0, 2.0])
    middle = MESH.points[MESH.cells, 1].mean(axis=1)
    mesh = replace(MESH, grain=np.searchsorted(lengths, middle))
    (grain,) = along({"tau0_grain3_band": -0.4, "tau0_grain3_band_middle": 0.5}, mesh=mesh)
    assert grain.grain == 3 and grain.band is not None
    np.testing.assert_allclose([grain.y[0], grain.y[-1]], [2.0, 4.0])
    np.testing.assert_allclose(grain.band.middle[0], 3.5)


def test_what_is_written_is_what_was_found() -> None:
    (grain,) = along({"tau0_grain2_band": -0.4})
    found = grain.record()
    assert found["grain"] == 2 and found["text"] == grain.sentence()
    assert found["y_um"] == grain.y.tolist() and found["ratio"] == grain.ratio.tolist()
    assert found["sigma"] == grain.sigma.tolist()
    assert grain.band is not None and found["band"] == {
        "ratio": [*grain.band.ratio], "middle_um": [*grain.band.middle],
        "width_um": [*grain.band.width],
    }  # fmt: skip
    (sloped,) = along({"tau0_grain2_slope_Y": 0.1})
    assert sloped.record()["band"] is None


def test_correlated_parameters_are_counted_together() -> None:
    """Of a slope and a bend that are known in their sum alone the end is known, not the other."""
    names = ("tau0_grain1_slope_Y", "tau0_grain1_bend_Y")
    every = {name: scalar(Material(), name) for name in PARAMETERS}
    covariance = np.array([[1.0, -1.0], [-1.0, 1.0]])
    fitted = SimpleNamespace(best=SimpleNamespace(free=names), values=every, covariance=covariance)
    (grain,) = stress_along_grains(MESH, cast(Fit, fitted), PARAMETERS)
    np.testing.assert_allclose(grain.sigma[[0, -1]], [0.2, 0.0], atol=1e-9)
