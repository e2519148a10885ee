from __future__ import annotations

import numpy as np
import pytest

from driver.images.flatfield import flat_pattern
from driver.images.heightmaps import ImageError

SIGMA = 0.009


def test_a_known_pattern_is_recovered_with_the_stated_error() -> None:
    rng = np.random.default_rng(3)
    row, col = np.indices((40, 60)) / 40.0
    pattern = 0.006 * np.sin(9 * row) * np.cos(7 * col)
    tilts = rng.normal(scale=0.02, size=(100, 3))
    flats = (
        0.4 + pattern + a + b * row + c * col + SIGMA * rng.normal(size=row.shape)
        for a, b, c in tilts
    )
    found = flat_pattern(flats)
    modes = np.linalg.qr(np.column_stack([np.ones(row.size), row.ravel(), col.ravel()]))[0]
    truth = pattern.ravel() - modes @ (modes.T @ pattern.ravel())
    error = found.pattern.ravel() - truth
    assert found.sigma == pytest.approx(SIGMA / 10, rel=0.01)  # 2400 × 99 degrees of freedom
    assert np.std(error) == pytest.approx(found.sigma, rel=0.05)  # sampling error 1.4 %
    assert np.abs(modes.T @ found.pattern.ravel()).max() < 1e-12


def test_flats_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ImageError, match="1 given"):
        flat_pattern(np.zeros((1, 4, 4)))
    with pytest.raises(ImageError, match="flat frame 1"):
        flat_pattern([np.zeros((4, 4)), np.zeros((5, 4))])
