from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import chi2

from driver.diagnosis.variance_component import Component, component, tail

FloatArray = NDArray[np.float64]

RNG = np.random.default_rng(4)
N, STOPS, FITTED = 120, 30, 6
JACOBIAN = 3.0 * RNG.standard_normal((FITTED, N))
EFFECT = 0.6 * RNG.standard_normal((STOPS, N))
PRIOR = np.diag([0.0, 0.0, 0.0, 4.0, 4.0, 4.0])


def fitted(data: FloatArray) -> Any:
    """A linear model at its optimum."""
    hessian = JACOBIAN @ JACOBIAN.T + PRIOR
    theta = np.linalg.solve(hessian, JACOBIAN @ data)
    residual = data - JACOBIAN.T @ theta
    gradient = JACOBIAN @ residual - PRIOR @ theta
    return cast(
        Any,
        SimpleNamespace(jacobian=JACOBIAN, hessian=hessian, residual=residual, gradient=gradient),
    )


def found(level: float, seed: int) -> Component:
    """For data with a component of √s = level, parameters drawn from their prior."""
    rng = np.random.default_rng(seed)
    theta = rng.standard_normal(FITTED) / np.sqrt(np.where(np.diag(PRIOR) > 0, np.diag(PRIOR), 1))
    noise = rng.standard_normal(N) + level * EFFECT.T @ rng.standard_normal(STOPS)
    return component(EFFECT, fitted(JACOBIAN.T @ theta + noise))


def test_the_tail_of_a_sum_of_chi_squares_is_that_of_draws() -> None:
    a = np.geomspace(100.0, 0.1, 8)
    # Of a million draws a thousand lie beyond the rarest quantile: it is known to 3 %.
    drawn = (np.random.default_rng(0).standard_normal((1_000_000, a.size)) ** 2) @ a
    for level in (0.5, 0.1, 0.01, 1e-3):
        assert tail(a, float(np.quantile(drawn, 1 - level))) == pytest.approx(level, rel=0.1)


def test_equal_strengths_have_the_tail_of_one_chi_square() -> None:
    for q in (1.0, 9.0, 40.0, 200.0):
        assert tail(np.full(10, 2.0), 2.0 * q) == pytest.approx(chi2.sf(q, 10), rel=0.02)


def test_the_likelihood_is_that_of_the_gaussian_with_the_parameters_integrated_out() -> None:
    """Against the dense covariance, every prior proper."""
    weight = PRIOR + 0.5 * np.eye(FITTED)
    data = np.random.default_rng(9).standard_normal(N)
    hessian = JACOBIAN @ JACOBIAN.T + weight
    theta = np.linalg.solve(hessian, JACOBIAN @ data)
    at: Any = SimpleNamespace(
        jacobian=JACOBIAN, hessian=hessian, residual=data - JACOBIAN.T @ theta, gradient=0.0 * theta
    )
    c = component(EFFECT, at)
    plain = np.eye(N) + JACOBIAN.T @ np.linalg.solve(weight, JACOBIAN)

    def log_likelihood(s: float) -> float:
        covariance = plain + s * EFFECT.T @ EFFECT
        return -0.5 * float(
            np.linalg.slogdet(covariance)[1] + data @ np.linalg.solve(covariance, data)
        )

    for s in (0.01, 0.3, 2.0):
        expected = log_likelihood(s) - log_likelihood(0.0)
        share = s * c.power / (1 + s * c.strength) - np.log1p(s * c.strength)
        assert 0.5 * share.sum() == pytest.approx(expected, rel=1e-8)


def test_under_the_null_p_is_uniform_and_the_evidence_against_it() -> None:
    drawn = [found(0.0, seed) for seed in range(400)]
    p = np.array([c.p for c in drawn])
    for level in (0.05, 0.3, 0.7):
        assert np.mean(p < level) == pytest.approx(level, abs=4 * np.sqrt(level / len(p)))
    assert np.median([c.log_evidence for c in drawn]) < 0


def test_a_level_is_found_within_its_standard_deviation() -> None:
    drawn = [found(0.7, seed) for seed in range(60)]
    off = np.array([(c.largest - 0.7) / c.spread for c in drawn])
    assert abs(off.mean()) < 0.5 and 0.6 < off.std() < 1.4
    assert all(c.p < 1e-6 and c.log_evidence > 5 for c in drawn)


def test_an_effect_of_the_visible_size_is_seen() -> None:
    visible = found(0.0, 0).visible
    assert np.median([found(visible, seed).p for seed in range(40)]) < 1e-3
    assert np.mean([found(0.2 * visible, seed).p for seed in range(40)]) > 0.05
