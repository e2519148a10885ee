from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from driver.common.splines.images import spline_images, variance_gain

PIXEL, ORIGIN = 0.11, (4.5, 3.0)


def test_values_agree_with_scipy_inside_and_mirrored_outside() -> None:
    rng = np.random.default_rng(8)
    stack = rng.normal(size=(3, 12, 17))
    images = spline_images(stack, PIXEL, ORIGIN)
    rows, cols = rng.uniform(-6, 18, (3, 200)), rng.uniform(-6, 23, (3, 200))
    x, y = (rows - ORIGIN[0]) * PIXEL, (cols - ORIGIN[1]) * PIXEL
    for t in range(3):
        expected = ndimage.map_coordinates(stack[t], [rows[t], cols[t]], order=3, mode="mirror")
        assert images.value(t, x[t], y[t]) == pytest.approx(expected, abs=1e-12)
    order = np.array([2, 0, 1])
    together = images.value(order, x[order], y[order])
    assert np.array_equal(together, [images.value(t, x[t], y[t]) for t in order])


def test_samples_are_met_at_the_pixels_in_any_shape() -> None:
    stack = np.random.default_rng(9).normal(size=(1, 8, 9))
    row, col = np.indices((8, 9), dtype=float)
    images = spline_images(stack, PIXEL, ORIGIN)
    x, y = (row - ORIGIN[0]) * PIXEL, (col - ORIGIN[1]) * PIXEL
    assert images.value(0, x, y) == pytest.approx(stack[0], abs=1e-12)
    assert images.gradient(0, x, y).shape == (8, 9, 2)


def test_gradient_is_the_derivative_in_micrometres() -> None:
    rng = np.random.default_rng(10)
    images = spline_images(rng.normal(size=(1, 20, 20)), PIXEL, ORIGIN)
    x, y = rng.uniform(0.0, 1.0, (2, 50))
    step = 1e-6
    slope = images.gradient(0, x, y)
    along_x = (images.value(0, x + step, y) - images.value(0, x - step, y)) / (2 * step)
    along_y = (images.value(0, x, y + step) - images.value(0, x, y - step)) / (2 * step)
    assert slope[:, 0] == pytest.approx(along_x, abs=1e-6)
    assert slope[:, 1] == pytest.approx(along_y, abs=1e-6)


@pytest.mark.parametrize("fraction", [(0.0, 0.0), (0.37, -0.21), (0.5, 0.5), (3.5, 0.1)])
def test_variance_gain_agrees_with_interpolated_noise(fraction: tuple[float, float]) -> None:
    noise = np.random.default_rng(11).normal(size=(1, 500, 500))
    row, col = np.indices((400, 400), dtype=float) + 50
    moved = spline_images(noise, 1.0, (0.0, 0.0)).value(0, row + fraction[0], col + fraction[1])
    gain = variance_gain(np.array(fraction[0]), np.array(fraction[1]))
    # 160000 pixels, correlated over about 2 × 2: standard error below 0.8 %
    assert moved.var() == pytest.approx(float(gain), rel=0.025)


def test_variance_gain_is_one_on_a_pixel_and_symmetric_between_two() -> None:
    t, on = np.linspace(0.0, 1.0, 11), np.zeros(11)
    gain = variance_gain(t, on)
    assert gain[[0, -1]] == pytest.approx(1.0, abs=1e-14)
    assert gain == pytest.approx(gain[::-1], abs=1e-14)
    # Σ η(½ − k)² summed directly from the response of the spline to a unit impulse
    impulse = np.zeros((1, 1, 101))
    impulse[0, 0, 50] = 1.0
    eta = spline_images(impulse, 1.0, (0.0, 0.0)).value(0, np.zeros(80), np.arange(10.5, 90.0))
    assert gain[5] == pytest.approx(float((eta**2).sum()), abs=1e-12)
