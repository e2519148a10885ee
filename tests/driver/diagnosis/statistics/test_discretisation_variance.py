from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from driver.diagnosis.causes.causes import Category, Cause
from driver.diagnosis.statistics.discretisation_variance import score_variance
from driver.diagnosis.statistics.score_test import Score, score
from driver.identification.data import Data
from driver.identification.mesh_error import patterns_left
from meshes.arrays import FloatArray
from meshes.prism import PrismGeometry, generate
from tests.driver.analytic import evaluation

RNG = np.random.default_rng(21)
T, N, K = 10, 400, 40
WORKING, FINER = 1.6, 1.0
MESH = generate(PrismGeometry(2.0, 2.0, 2.0), WORKING)
Patterns = list[tuple[FloatArray, FloatArray]]


def data(counted: float) -> Data:
    """Whitened numbers are the motion itself, of whose variance the error's share is counted."""

    def change(motion: FloatArray, load: FloatArray) -> FloatArray:
        return motion.ravel()

    def noise_part(rows: FloatArray) -> FloatArray:
        return np.asarray(np.sqrt(1.0 - counted) * rows)

    return cast(Data, SimpleNamespace(change=change, noise_part=noise_part))


def scores(category: Category) -> list[Score]:
    """Of causes of one parameter each, along the first K numbers."""
    baseline = evaluation(RNG.standard_normal(N), np.eye(1, N, N - 1), n_load=T)
    causes = [Cause(str(k), category, (f"p{k}",), "", "") for k in range(K)]
    return [score(cause, 3.0 * np.eye(1, N, k), baseline, K) for k, cause in enumerate(causes)]


def left_by(of_causes: float, elsewhere: float) -> Patterns:
    """Of two meshes that err each in its own way, in proportion to their sizes."""
    spread = np.where(np.arange(N) < K, of_causes, elsewhere)
    fine, coarse = (h * spread * RNG.standard_normal(N) for h in (FINER, WORKING))
    change = (coarse - fine).reshape(T, -1, 1), np.zeros(T)
    return patterns_left(MESH, (WORKING, FINER), change, np.ones(T))


def test_what_the_finer_mesh_leaves_along_the_causes_is_told_from_the_patterns() -> None:
    """Its variance there is (h_fine · 1.5)²; what happens elsewhere says nothing."""
    found = [
        score_variance(scores("material"), data(0.0), left_by(1.5, elsewhere))
        for elsewhere in (0.0, 20.0)
        for _ in range(50)
    ]
    # 40 numbers, 100 draws: 2 %
    assert np.mean(found) - 1.0 == pytest.approx((FINER * 1.5) ** 2, rel=0.08)


def test_what_the_whitening_counts_already_is_not_counted_twice() -> None:
    large = left_by(1.5, 0.0)
    whole = score_variance(scores("boundary"), data(0.0), large)
    assert whole - score_variance(scores("boundary"), data(0.4), large) == pytest.approx(0.4)
    assert score_variance(scores("boundary"), data(0.9), left_by(0.1, 0.0)) == 1.0


def test_patterns_that_are_independent_of_each_other_add() -> None:
    both = left_by(1.5, 0.0) + left_by(0.7, 0.0)
    alone = [score_variance(scores("material"), data(0.0), [one]) - 1.0 for one in both]
    together = score_variance(scores("material"), data(0.0), both) - 1.0
    assert together == pytest.approx(sum(alone)) and min(alone) > 0.1


def test_without_a_correction_or_causes_of_the_specimen_noise_alone_counts() -> None:
    assert score_variance(scores("material"), data(0.0), []) == 1.0
    large = left_by(9.0, 9.0)
    assert score_variance(scores("instrument"), data(0.0), large) == 1.0
    assert score_variance([], data(0.0), large) == 1.0


def test_a_wider_score_is_that_of_data_as_much_noisier() -> None:
    baseline: Any = evaluation(RNG.standard_normal(N), np.eye(1, N, N - 1), n_load=T)
    louder: Any = evaluation(baseline.residual / 2.0, np.eye(1, N, N - 1), n_load=T)
    cause = Cause("x", "material", ("p",), "", "")
    effect = 3.0 * RNG.standard_normal((1, N))
    augmented, noisy = (
        score(cause, effect, baseline, K, variance=4.0),
        score(cause, effect / 2, louder, K),
    )
    for name in ("statistic", "p", "log_evidence", "estimate", "sigma", "visible", "strengths"):
        np.testing.assert_allclose(getattr(augmented, name), getattr(noisy, name), rtol=1e-9)
