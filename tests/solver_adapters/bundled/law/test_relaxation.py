"""The relaxation of an overstress against numerical quadrature and integration in time."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp

from solver_adapters.bundled.law import relaxation
from tests.solver_adapters.bundled.from_python import FromPython

kernels = FromPython(relaxation)

FALLS = (1e-9, 1e-4, 0.05, 0.0999, 0.1001, 0.7, 3.0, 20.0)
EXPONENTS = (1.5, 3.0, 10.0, 30.0)


def ratio(r: float, n: float) -> float:
    return float(kernels.rate_ratio(r, np.exp(-r), np.exp(-(n - 1) * r), n))


@pytest.mark.parametrize("n", EXPONENTS)
@pytest.mark.parametrize("r", FALLS)
def test_the_ratio_is_the_harmonic_mean_of_the_rate_over_the_overstress(r: float, n: float) -> None:
    integral, _ = quad(lambda z: np.exp((n - 1) * z), 0.0, r, epsabs=0, epsrel=1e-12)
    np.testing.assert_allclose(ratio(r, n), -np.expm1(-r) / integral, rtol=1e-10)


def test_a_hold_relaxes_as_its_differential_equation() -> None:
    """dv/dt = −M (v/K)ⁿ for 30 s, from the mean rate of the whole hold."""
    M, K, n, v0, hold = 80e3, 12.0, 10.0, 5.5, 30.0
    solution = solve_ivp(
        lambda t, v: -M * (v / K) ** n, (0, hold), [v0], method="Radau", rtol=1e-10, atol=1e-12
    )
    end = float(solution.y[0, -1])
    slip = (v0 - end) / M
    np.testing.assert_allclose(slip / hold, ratio(np.log(v0 / end), n) * (v0 / K) ** n, rtol=1e-6)


@pytest.mark.parametrize("n", EXPONENTS)
@pytest.mark.parametrize("r", FALLS[1:])
def test_slopes_are_difference_quotients(r: float, n: float) -> None:
    h = 1e-5 * r
    e, e_a = np.exp(-r), np.exp(-(n - 1) * r)
    along = (np.log(ratio(r + h, n)) - np.log(ratio(r - h, n))) / (2 * h)
    np.testing.assert_allclose(kernels.rate_slope(r, e, e_a, n), -along, rtol=1e-5)
    k = 1e-5 * n
    across = (np.log(ratio(r, n + k)) - np.log(ratio(r, n - k))) / (2 * k)
    np.testing.assert_allclose(kernels.rate_change(r, e_a, n), -across, rtol=1e-5, atol=1e-12)


def test_series_and_closed_forms_meet() -> None:
    below, above = 0.1 * (1 - 1e-12), 0.1 * (1 + 1e-12)
    for function in (kernels.mean_decay, kernels.decay_slope):
        (series, one), (closed, divisor) = (function(u, np.exp(-u)) for u in (below, above))
        assert one == 1.0
        np.testing.assert_allclose(series, closed / divisor, rtol=1e-11)


@pytest.mark.parametrize("n", (3.0, 10.0, 30.0))
@pytest.mark.parametrize("r", FALLS)
def test_the_first_guess_is_near_and_on_the_side_from_which_newton_is_monotone(
    r: float, n: float
) -> None:
    guess = kernels.near_fall(np.log(ratio(r, n)), n)
    assert r * (1 - 1e-6) - 1e-12 <= guess <= 1.25 * r + 1e-9
