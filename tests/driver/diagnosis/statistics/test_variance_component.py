from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from driver.diagnosis.statistics.variance_component import Component, component, tail
from meshes.arrays import FloatArray

N, STOPS = 60, 40
# Some numbers answer, others hardly: as loads do in elastic and in plastic stretches.
EFFECT = np.random.default_rng(4).standard_normal((STOPS, N)) * np.geomspace(1.0, 0.02, N) * 0.6


def found(level: float, seed: int, noise: float = 1.0) -> Component:
    """For numbers with a component of √s = level."""
    rng = np.random.default_rng(seed)
    return component(
        EFFECT, noise * rng.standard_normal(N) + level * EFFECT.T @ rng.standard_normal(STOPS)
    )


def test_the_tail_of_a_sum_of_chi_squares_is_that_of_draws() -> None:
    for a in (np.geomspace(100.0, 0.1, 8), np.linspace(-3.0, 1.0, 12), -np.arange(1.0, 9.0)):
        # Four hundred draws lie beyond the rarest quantile: it is known to 5 %.
        drawn = (np.random.default_rng(0).standard_normal((400_000, a.size)) ** 2) @ a
        for level in (0.99, 0.5, 0.1, 0.01, 1e-3):
            assert tail(a, float(np.quantile(drawn, 1 - level))) == pytest.approx(level, rel=0.15)


def test_equal_strengths_have_the_tail_of_one_chi_square() -> None:
    for q in (1.0, 9.0, 10.0, 40.0, 200.0):
        assert tail(np.full(10, 2.0), 2.0 * q) == pytest.approx(chi2.sf(q, 10), rel=0.02)


def test_the_likelihood_is_that_of_the_gaussian_with_the_best_noise() -> None:
    """Against the dense covariance, over a grid of both levels."""
    numbers = np.random.default_rng(9).standard_normal(N) + 0.5 * EFFECT.sum(axis=0)
    gram = EFFECT.T @ EFFECT

    def log_likelihood(level: float, noise: float) -> float:
        covariance = noise**2 * np.eye(N) + level**2 * gram
        return -0.5 * float(
            np.linalg.slogdet(covariance)[1] + numbers @ np.linalg.solve(covariance, numbers)
        )

    c = component(EFFECT, numbers)
    best = log_likelihood(c.level, c.noise)
    null = log_likelihood(0.0, float(np.sqrt(np.mean(numbers**2))))
    assert c.ratio == pytest.approx(2 * (best - null), rel=1e-3)
    for factor in (0.9, 0.97, 1.03, 1.1):
        assert log_likelihood(factor * c.level, c.noise) < best
        assert log_likelihood(c.level, factor * c.noise) < best


def far(level: float, p: FloatArray) -> float:
    """Three standard deviations of a share."""
    return 3.0 * float(np.sqrt(level * (1 - level) / len(p)))


@pytest.mark.parametrize("noise", [0.4, 1.0, 5.0])
def test_under_the_null_p_is_uniform_whatever_the_noise_and_the_evidence_against_it(
    noise: float,
) -> None:
    drawn = [found(0.0, seed, noise) for seed in range(150)]
    p = np.array([c.p for c in drawn])
    for level in (0.05, 0.3, 0.7):
        # Twice the least of two probabilities that go together.
        assert level / 2 - far(level, p) < np.mean(p < level) < level + far(level, p)
    assert np.median([c.log_evidence for c in drawn]) < 0


@pytest.mark.parametrize("noise", [0.5, 1.0, 2.0])
def test_a_level_is_found_without_bias_and_the_noise_beside_it(noise: float) -> None:
    drawn = [found(1.5 * noise, seed, noise) for seed in range(64)]
    levels = np.array([c.level for c in drawn]) / (1.5 * noise)
    assert abs(levels.mean() - 1) < 3 * levels.std() / 8 < 0.1
    noises = np.array([c.noise for c in drawn]) / noise
    assert abs(noises.mean() - 1) < 3 * noises.std() / 8 + 0.01
    spread = np.mean([c.spread for c in drawn]) / (1.5 * noise)
    assert levels.std() == pytest.approx(spread, rel=0.3)
    assert np.mean([c.p < 1e-4 and c.log_evidence > 5 for c in drawn]) > 0.95


def test_an_effect_of_the_visible_size_is_seen() -> None:
    visible = float(np.median([found(0.0, seed).visible for seed in range(40)]))
    assert np.median([found(visible, seed).p for seed in range(40)]) < 1e-3
    assert np.mean([found(0.2 * visible, seed).p for seed in range(40)]) > 0.05


def test_a_component_that_is_noise_of_another_level_is_not_told_from_it() -> None:
    c = component(2.0 * np.eye(30), 5.0 * np.random.default_rng(0).standard_normal(30))
    assert not c.told_apart and c.p == 1.0 and c.level == 0 and np.isinf(c.visible)
