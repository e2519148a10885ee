"""A reference less its noise, against a relief in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from driver.noise_floor.quiet import without_noise
from meshes.arrays import FloatArray

SHAPE, SIGMA, N = (80, 150), 9.0, 10
ROW, COL = np.indices(SHAPE, dtype=np.float64)
REGION = np.s_[15:65, 20:130]


def relief() -> FloatArray:
    """Dots 20 high and 8 px wide on a tilted plane."""
    heights = 0.3 * ROW - 0.2 * COL + 500.0
    for row, col in np.random.default_rng(0).uniform((0, 0), SHAPE, (150, 2)):
        heights += 20.0 * np.exp(-((ROW - row) ** 2 + (COL - col) ** 2) / (2 * 2.5**2))
    return heights


def squared_slopes(heights: FloatArray) -> float:
    rows, columns = np.asarray(np.gradient(heights))
    return float(rows[REGION].var() + columns[REGION].var())


def test_the_slopes_of_the_relief_are_left_and_those_of_the_noise_taken() -> None:
    clean = relief()
    noise = SIGMA / np.sqrt(N) * np.random.default_rng(1).normal(size=SHAPE)
    quiet = without_noise(clean + noise, REGION, SIGMA, N)
    # Central differences: the noise adds σ²/n to the squared slopes, here more than half.
    assert squared_slopes(clean + noise) > 1.5 * squared_slopes(clean)
    assert squared_slopes(quiet) == pytest.approx(squared_slopes(clean), rel=0.05)
    assert (quiet - clean)[REGION].std() < 0.5 * noise[REGION].std()


def test_a_reference_without_noise_passes_unchanged() -> None:
    np.testing.assert_allclose(without_noise(relief(), REGION, 1e-9, N), relief(), atol=1e-6)
