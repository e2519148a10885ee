from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from driver.common.splines.images import variance_gain
from driver.experiment.images.flatfield import flat_pattern, left_over, without_noise
from driver.experiment.images.heightmaps import ImageError
from meshes.arrays import FloatArray

SIGMA = 0.009


def test_a_known_pattern_is_recovered_with_the_stated_error() -> None:
    rng = np.random.default_rng(3)
    row, col = np.indices((40, 60)) / 40.0
    pattern = 0.006 * np.sin(9 * row) * np.cos(7 * col)
    tilts = rng.normal(scale=0.02, size=(100, 3))
    flats = [
        0.4 + pattern + a + b * row + c * col + SIGMA * rng.normal(size=row.shape)
        for a, b, c in tilts
    ]
    found = flat_pattern(flats)
    modes = np.linalg.qr(np.column_stack([np.ones(row.size), row.ravel(), col.ravel()]))[0]
    truth = pattern.ravel() - modes @ (modes.T @ pattern.ravel())
    error = found.pattern.ravel() - truth
    assert found.sigma == pytest.approx(SIGMA / 10, rel=0.01)  # 2400 × 99 degrees of freedom
    assert np.std(error) == pytest.approx(found.sigma, rel=0.05)  # sampling error 1.4 %
    assert np.abs(modes.T @ found.pattern.ravel()).max() < 1e-12


def test_a_smooth_pattern_loses_most_of_the_noise_of_its_flats_and_a_rough_one_stays() -> None:
    rng = np.random.default_rng(6)
    row, col = np.indices((40, 60)) / 40.0
    smooth = 0.006 * np.sin(9 * row) * np.cos(7 * col)
    rough = 0.02 * rng.normal(size=row.shape)
    for pattern, left in ((smooth, 0.4), (rough, 1.1)):
        found = flat_pattern(pattern + SIGMA * rng.normal(size=(20, *row.shape)))
        error = _levelled(without_noise(found) - pattern)
        assert np.std(error) < left * np.std(_levelled(found.pattern - pattern))
    of_noise = flat_pattern(SIGMA * rng.normal(size=(20, *row.shape)))
    assert np.std(without_noise(of_noise)) < 0.3 * np.std(of_noise.pattern)


def _levelled(heights: FloatArray) -> FloatArray:
    row, col = np.indices(heights.shape)
    modes = np.linalg.qr(np.column_stack([np.ones(row.size), row.ravel(), col.ravel()]))[0]
    return np.asarray(heights - (modes @ (modes.T @ heights.ravel())).reshape(heights.shape))


def test_flats_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ImageError, match="1 given"):
        flat_pattern(np.zeros((1, 4, 4)))
    with pytest.raises(ImageError, match="flat frame 1"):
        flat_pattern([np.zeros((4, 4)), np.zeros((5, 4))])


def test_the_error_is_right_at_each_pixel_where_the_noise_is_not_uniform() -> None:
    rng = np.random.default_rng(5)
    sigma = np.where(np.arange(60) < 30, 1.0, 3.0) * SIGMA
    found = flat_pattern(sigma * rng.normal(size=(60, 40, 60)))
    truth = sigma / np.sqrt(60)
    # each estimate has 59 degrees of freedom, 1200 pixels a half: 0.27 % on the mean square
    for half in (np.s_[:, :30], np.s_[:, 30:]):
        assert np.mean((found.error / truth)[half] ** 2) == pytest.approx(1.0, abs=0.012)
        assert np.mean((found.pattern / truth)[half] ** 2) == pytest.approx(1.0, abs=0.12)


def test_dirt_and_holes_in_single_flats_leave_the_pattern_alone() -> None:
    rng = np.random.default_rng(6)
    flats = SIGMA * rng.normal(size=(50, 30, 40))
    clean = flat_pattern(flats)
    flats[7, 10:14, 20:24] += 0.5
    flats[9, 3:5, 3:9] = np.nan
    flats[:, 25, 30] = np.nan
    found = flat_pattern(flats)
    change = np.abs(found.pattern - clean.pattern)
    assert change[10:14, 20:24].max() < SIGMA / 5  # of 0.5/50 = 10 nm, what noise does
    change[10:14, 20:24] = change[3:5, 3:9] = change[25, 30] = 0.0
    assert change.max() < 1e-4
    assert found.error[10, 20] == pytest.approx(SIGMA / np.sqrt(49), rel=0.4)
    assert np.isfinite(found.pattern).all()
    assert found.error[25, 30] == pytest.approx(np.std(found.pattern), rel=0.05)


def test_what_the_error_adds_to_a_residual_is_that_of_a_simulation() -> None:
    """e(x + u) − e(x) of white e, interpolated by the splines of SciPy."""
    rng = np.random.default_rng(7)
    error = rng.normal(size=(300, 300))
    rows, cols = np.indices((260, 260)) + 20.0
    for u, v in ((0.0, 0.0), (0.3, 0.0), (0.5, 0.4), (1.0, 2.0), (3.5, -2.2)):
        moved = ndimage.map_coordinates(error, [rows + u, cols + v], mode="mirror")
        expected = np.var(moved - error[20:280, 20:280])
        displacement = np.array([u, v])
        gain = variance_gain(np.array(u), np.array(v))
        # 67 600 correlated squares: about 1 %
        assert left_over(displacement, gain) == pytest.approx(expected, rel=0.03, abs=1e-9)
