from __future__ import annotations

import numpy as np
import pytest

from driver.images.heightmaps import ImageError
from driver.images.noise import noise_from_repeats


def test_noise_is_measured_through_drift_and_tilt_of_the_stage() -> None:
    rng = np.random.default_rng(4)
    row, col = np.indices((40, 60)) / 40.0
    surface = 0.1 * np.sin(20 * row) + 0.1 * np.cos(15 * col)
    drift = rng.normal(scale=0.05, size=(10, 3))
    repeats = surface + np.array([a + b * row + c * col for a, b, c in drift])
    repeats = repeats + 0.009 * rng.normal(size=repeats.shape)
    mask = (row > 0.2) & (row < 0.8)
    noise = noise_from_repeats(repeats, mask)
    assert noise.dof == 9 * (mask.sum() - 3)
    assert abs(noise.sigma / 0.009 - 1) < 3 / np.sqrt(2 * noise.dof)


def test_repeats_that_tell_nothing_are_refused() -> None:
    mask = np.ones((4, 4), bool)
    with pytest.raises(ImageError, match="1 frames"):
        noise_from_repeats(np.ones((1, 4, 4)), mask)
    with pytest.raises(ImageError, match="identical"):
        noise_from_repeats(np.ones((3, 4, 4)), mask)
