from __future__ import annotations

import numpy as np
import pytest

from driver.dic.travel import smooth_along_travel
from driver.images.heightmaps import ImageError

TRAVEL = np.concatenate([np.arange(0.0, 100.0, 5.0), np.arange(100.0, 40.0, -5.0)])


def test_a_motion_linear_between_turning_points_passes_unchanged() -> None:
    motion = np.stack([0.3 * TRAVEL - 1.0, np.where(np.arange(32) <= 20, TRAVEL, 100.0)], axis=1)
    smoothed = smooth_along_travel(motion, TRAVEL, 20.0, 10)
    assert smoothed.coefficients == pytest.approx(motion, abs=1e-9)


def test_the_scatter_over_draws_has_the_stated_covariance() -> None:
    rng = np.random.default_rng(4)
    n_draws, n_reference = 4000, 4
    own = rng.normal(size=(len(TRAVEL), n_draws))
    shared = rng.normal(size=n_draws) / np.sqrt(n_reference)
    smoothed = smooth_along_travel(own + shared, TRAVEL, 10.0, n_reference)
    found = np.cov(smoothed.coefficients)
    # standard error of a variance of 4000 draws: 2.2 %
    assert found == pytest.approx(smoothed.covariance_in_time, abs=0.1)
    gain = smoothed.covariance_in_time.diagonal() / (1 + 1 / n_reference)
    assert (gain < 1).all() and gain[10] < 0.6


@pytest.mark.parametrize(
    ("travel", "length", "said"),
    [
        (TRAVEL[:-1], 10.0, "there are 32 images"),
        (TRAVEL, 0.0, "length = 0.0 µm"),
        (np.zeros(32), 10.0, "did not travel"),
    ],
)
def test_bad_input_is_refused_in_one_sentence(travel: np.ndarray, length: float, said: str) -> None:
    with pytest.raises(ImageError, match=said):
        smooth_along_travel(np.zeros((32, 2)), travel, length, 10)
