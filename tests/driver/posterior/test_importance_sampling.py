"""Posteriors whose moments are known: a Gaussian, a bent one by quadrature, one with a bound."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm

from driver.posterior.importance_sampling import TRUSTED, proposals, weighted
from meshes.arrays import FloatArray

HESSIAN = np.array([[4.0, 1.0, 0.0], [1.0, 2.0, -0.5], [0.0, -0.5, 9.0]])


def test_of_a_gaussian_the_moments_are_those_of_its_hessian() -> None:
    drawn = proposals(HESSIAN, 4000, 1)
    costs = np.einsum("ni,ij,nj->n", drawn.theta, HESSIAN, drawn.theta)
    found = weighted(costs, drawn)
    sigma = np.sqrt(np.diag(np.linalg.inv(HESSIAN)))
    # Standard errors of 4000 draws: of a mean 0.016 σ, of a σ 0.011.
    np.testing.assert_allclose(found.mean(drawn.theta) / sigma, 0, atol=0.06)
    np.testing.assert_allclose(found.deviation(drawn.theta) / sigma, 1, atol=0.05)
    assert found.shape < 0.5 and 3000 < found.effective <= 4000
    shares = np.array([0.025, 0.5, 0.975])
    expected = norm.ppf(shares) * sigma[0]
    quantiles = found.quantiles(drawn.theta[:, 0], shares)
    np.testing.assert_allclose(quantiles, expected, atol=0.15 * sigma[0])


def bent(theta: FloatArray) -> FloatArray:
    """A cost whose valley is a parabola, and steeper to one side."""
    x, y = theta[..., 0], theta[..., 1]
    return np.asarray(x**2 * (1 + 0.3 * np.tanh(x)) + 4 * (y - 0.15 * x**2) ** 2)


def test_of_a_bent_posterior_the_moments_are_those_of_quadrature() -> None:
    drawn = proposals(np.diag([1.0, 4.0]), 20000, 2)
    found = weighted(bent(drawn.theta), drawn)
    x, y = np.meshgrid(np.linspace(-8, 8, 1601), np.linspace(-6, 30, 3601), indexing="ij")
    density = np.exp(-0.5 * bent(np.stack([x, y], axis=-1)))
    density /= density.sum()
    assert found.shape < TRUSTED
    for k, axis in enumerate((x, y)):
        mean = float(np.sum(density * axis))
        sigma = float(np.sqrt(np.sum(density * (axis - mean) ** 2)))
        assert found.mean(drawn.theta)[k] == pytest.approx(mean, abs=0.05 * sigma)
        assert found.deviation(drawn.theta)[k] == pytest.approx(sigma, rel=0.06)
    # The Gaussian of the Hessian has both means at 0, and is off by a quarter of σ.
    assert found.mean(drawn.theta)[1] > 0.25 * 0.5


def test_where_the_posterior_is_zero_a_draw_has_no_weight() -> None:
    drawn = proposals(np.eye(1), 8000, 3)
    costs = np.where(drawn.theta[:, 0] > 0, drawn.theta[:, 0] ** 2, np.inf)
    found = weighted(costs, drawn)
    # Half a normal distribution.
    assert found.mean(drawn.theta)[0] == pytest.approx(np.sqrt(2 / np.pi), abs=0.03)
    assert not found.weights[drawn.theta[:, 0] < 0].any()


def test_a_posterior_of_heavier_tails_than_the_draws_is_not_trusted() -> None:
    drawn = proposals(np.eye(4), 400, 4)
    costs = 0.2 * np.sum(drawn.theta**2, axis=1) ** 0.5
    assert weighted(costs, drawn).shape > TRUSTED


def test_draws_are_the_same_for_the_same_seed() -> None:
    one, same, other = (proposals(HESSIAN, 5, seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one.theta, same.theta)
    assert not np.array_equal(one.theta, other.theta)


def test_draws_lie_about_the_stated_middle_with_the_density_of_the_others() -> None:
    middle = np.array([3.0, -2.0, 0.5])
    one, other = proposals(HESSIAN, 50, 1), proposals(HESSIAN, 50, 1, middle)
    np.testing.assert_allclose(other.theta - middle, one.theta, atol=1e-12)
    np.testing.assert_allclose(other.log_density, one.log_density, rtol=1e-9)
