from __future__ import annotations

import numpy as np
import pytest

from driver.common.splines.images import spline_images
from driver.dic.slope_noise import SLOPE_GAIN, squared_slopes
from driver.dic.surface_images import prepare

PIXEL, SIGMA, N = 0.1, 0.03, 9


def test_the_slope_of_a_spline_through_white_noise_has_the_stated_variance() -> None:
    noise = np.random.default_rng(0).standard_normal((400, 400))
    row, col = (a.ravel() for a in np.indices((360, 360)) + 20.0)
    slopes = spline_images(noise[None], 1.0, (0.0, 0.0)).gradient(0, row, col)
    assert slopes.var(axis=0) == pytest.approx(SLOPE_GAIN, rel=0.02)


def test_the_squared_slopes_are_those_of_relief_and_noise_together() -> None:
    """Waves along X and Y, of mean squared slopes (A k)²/2 (analytic)."""
    rng = np.random.default_rng(0)
    size, wavelength = np.array([0.1, 0.2]), np.array([31.0, 37.0])  # µm, px
    x, y = np.indices((300, 200))
    wave = sum(
        amplitude * np.sin(2 * np.pi * at / length)
        for amplitude, length, at in zip(size, wavelength, (x, y), strict=True)
    )
    repeats = wave + SIGMA * rng.standard_normal((N, *x.shape))
    bounds = (0.5, 29.5, 0.5, 19.5)
    images = prepare(repeats[:1], repeats, None, PIXEL, (0.0, 0.0), bounds, mask_dust=False)
    squares, noise = squared_slopes(images)
    slope = size * 2 * np.pi / (wavelength * PIXEL)
    assert noise == pytest.approx(SLOPE_GAIN * (SIGMA / PIXEL) ** 2 / N, rel=0.01)
    assert squares == pytest.approx(slope**2 / 2 + noise, rel=0.03)
