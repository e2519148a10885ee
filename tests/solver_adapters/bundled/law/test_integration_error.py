"""The estimate of a step's error against the error that one finds by many steps."""

from __future__ import annotations

import numpy as np
import pytest

from meshes.arrays import FloatArray
from solver_adapters.bundled.law import relaxation
from solver_adapters.bundled.law.gauss_points import Points, points_of_grains
from solver_adapters.bundled.law.integration_error import _relaxed, stress_error
from solver_adapters.crystal import bunge_matrix
from solver_adapters.interface import Integration
from solver_adapters.material import Material
from tests.solver_adapters.bundled.from_python import FromPython
from tests.solver_adapters.bundled.rest import state_at_rest

kernels = FromPython(relaxation)

R = bunge_matrix(281, 8, 47)[None]
STRETCH = np.diag([-0.45, 1.0, -0.55])


def taken(
    points: Points, state: FloatArray, start: float, end: float, dt: float, steps: int
) -> tuple[FloatArray, float, FloatArray]:
    """State, axial stress and slips of the last step after a strain taken in equal steps."""
    slips = np.zeros((1, 24))
    for strain in np.linspace(start, end, steps + 1)[1:]:
        H = (strain * STRETCH @ R[0]).reshape(1, 9)
        found = points.update(H, state, slips, dt / steps)
        assert found.iterations[0] >= 0
        state, slips = found.state, found.slips
    return state, float((found.P.reshape(3, 3) @ R[0].T)[1, 1]), slips


@pytest.mark.parametrize("integration", ["exponential", "backward_euler"])
@pytest.mark.parametrize(
    ("before", "after"), [(0.0, 0.004), (0.004, 0.006), (0.006, 0.0055), (0.006, 0.006)]
)
def test_the_estimate_is_no_less_than_a_third_of_the_error_and_no_idle_alarm(
    before: float, after: float, integration: Integration
) -> None:
    """First yield, steady flow, a reversal, a hold."""
    points = points_of_grains(
        Material(strain_measure="small"), integration, np.zeros(1, dtype=np.int64), R
    )
    state = state_at_rest(points)
    if before:
        state, _, _ = taken(points, state, 0.0, before, 4.0, 400)
    _, coarse, slips = taken(points, state, before, after, 2.0, 1)
    _, exact, _ = taken(points, state, before, after, 2.0, 1000)
    dH = ((after - before) * STRETCH @ R[0]).reshape(1, 9)
    estimate = float(stress_error(points, state, slips, dH, 2.0)[0])
    error = abs(coarse - exact)
    assert estimate > error / 3 - 0.01
    assert estimate < 30 * error + 3.0


@pytest.mark.parametrize("a", [0.02, 0.3, 2.0, 10.0])
def test_the_end_of_a_linear_relaxation_follows_from_its_mean(a: float) -> None:
    """dv/dt = −v/t over a relaxation times: the mean is (1 − exp(−a))/a, the end exp(−a)."""
    one = np.ones((1, 1))
    end = float(_relaxed(-np.expm1(-a) / a * one, one, one)[0, 0])
    assert np.exp(-a) <= end < np.exp(-a) + 0.06


@pytest.mark.parametrize("ratio", [1e-3, 0.1, 0.5, 0.9, 0.9999, 1.0])
@pytest.mark.parametrize("n", [1.5, 1.7, 1.99, 2.0, 2.01, 5.0, 30.0])
def test_the_end_of_a_relaxation_is_the_first_guess_of_the_kernel(n: float, ratio: float) -> None:
    """Below n = 2 the larger fall of both tangents, above it the smaller."""
    v0, mean = np.full((1, 1), 5.0), np.full((1, 1), 5.0 * ratio)
    end = float(_relaxed(mean, v0, np.full((1, 1), n))[0, 0])
    assert end == pytest.approx(5.0 * np.exp(-kernels.near_fall(n * np.log(ratio), n)), rel=1e-12)


@pytest.mark.parametrize("fall", [0.05, 0.5, 2.0])
@pytest.mark.parametrize("n", [1.5, 1.8, 3.0, 10.0])
def test_the_end_of_a_relaxation_is_near_that_of_the_exact_mean_rate(n: float, fall: float) -> None:
    """Both tangents lie on one side of ln ρ, another below n = 2 than above."""
    rate = kernels.rate_ratio(fall, np.exp(-fall), np.exp(-(n - 1) * fall), n)
    one = np.ones((1, 1))
    end = float(_relaxed(rate ** (1 / n) * one, one, n * one)[0, 0])
    exact = np.exp(-fall)
    assert end <= exact * (1 + 1e-12) if n > 2.0 else end >= exact * (1 - 1e-12)
    assert abs(np.log(end) + fall) < 0.3 * fall
