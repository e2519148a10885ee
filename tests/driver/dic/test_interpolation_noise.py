"""Noise of the right-hand side, against interpolation written out and against draws."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.sparse import csr_array

from driver.common.splines.images import noise_autocorrelation, spline_images, variance_gain
from driver.dic.interpolation_noise import (
    mean_autocorrelation,
    noise_of_right_side,
    noise_of_weights,
)
from driver.dic.series import measure
from driver.dic.surface_images import prepare
from meshes.arrays import FloatArray

SHAPE = (34, 36)


def region() -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Pixels of a rectangle with a hole, away from the mirrored border."""
    inside = np.zeros(SHAPE, dtype=bool)
    inside[12:22, 12:24] = True
    inside[15:17, 16:20] = False
    rows, cols = np.nonzero(inside)
    return rows, cols


def interpolation(row_shift: float, col_shift: float) -> FloatArray:
    """What each pixel of an image adds to its value at the moved pixels, by unit images."""
    rows, cols = region()
    images = spline_images(np.eye(math.prod(SHAPE)).reshape(-1, *SHAPE), 1.0, (0.0, 0.0))
    every = np.arange(math.prod(SHAPE))
    x, y = rows + row_shift, cols + col_shift
    return images.value(every, np.tile(x, (len(every), 1)), np.tile(y, (len(every), 1))).T


@pytest.mark.parametrize("shift", [(0.5, 0.5), (0.25, -1.375), (0.0, 0.625)])
def test_the_noise_of_a_frame_is_that_of_interpolation_written_out(
    shift: tuple[float, float],
) -> None:
    rows, cols = region()
    s = np.random.default_rng(0).normal(size=(len(rows), 5))
    motion = np.broadcast_to(shift, (3, len(rows), 2))
    shared = mean_autocorrelation(motion)
    found = noise_of_right_side(csr_array(s), rows, cols, shared, 10**9).toarray()
    np.testing.assert_allclose(
        noise_of_weights(s.T, rows, cols, shared), found.diagonal(), rtol=1e-8
    )
    weights = interpolation(*shift)
    expected = s.T @ weights @ weights.T @ s
    # Noise six and more pixels apart is left out.
    np.testing.assert_allclose(found, expected, atol=0.01 * expected.max())


def test_frames_moved_by_whole_pixels_have_white_noise_and_the_reference_always() -> None:
    rows, cols = region()
    s = np.random.default_rng(1).normal(size=(len(rows), 4))
    whole = np.broadcast_to([2.0, -1.0], (2, len(rows), 2))
    found = noise_of_right_side(csr_array(s), rows, cols, mean_autocorrelation(whole), 1).toarray()
    np.testing.assert_allclose(found, s.T @ s, atol=1e-10)
    n = 4
    half = [
        noise_of_right_side(
            csr_array(s), rows, cols, mean_autocorrelation(whole + 0.5), k
        ).toarray()
        for k in (n, 10**9)
    ]
    np.testing.assert_allclose(half[0], (half[1] + s.T @ s / n) / (1 + 1 / n), rtol=1e-7)


def test_interpolation_shares_noise_among_neighbours_and_leaves_slow_noise_whole() -> None:
    t = np.array([0.0, 0.2, -0.5, 1.9])
    shared = noise_autocorrelation(t, 12)
    np.testing.assert_allclose(shared[:, 0], variance_gain(t, np.zeros(4)), rtol=1e-12)
    np.testing.assert_allclose(shared[:, 0] + 2 * shared[:, 1:].sum(axis=1), 1.0, atol=1e-6)


def rough(row: FloatArray, col: FloatArray) -> FloatArray:
    """Heights [µm] of a random relief of 3.2 to 6 px wavelength, in closed form."""
    height = np.zeros(np.broadcast_shapes(row.shape, col.shape))
    rng = np.random.default_rng(9)
    for angle, wavelength, phase in rng.uniform((0, 3.2, 0), (np.pi, 6, 2 * np.pi), (80, 3)):
        k = 2 * np.pi / wavelength
        height = height + 0.01 * np.cos(k * (np.cos(angle) * row + np.sin(angle) * col) + phase)
    return height


@pytest.mark.parametrize("shift", [0.0, 0.5])
def test_the_covariance_is_the_scatter_of_100_draws_wherever_the_pixels_fall(shift: float) -> None:
    row, col = np.indices((48, 88), dtype=np.float64)
    rng, noise = np.random.default_rng(10), 0.004
    frames = rough(row - shift, col + shift) + noise * rng.normal(size=(100, *row.shape))
    repeats = rough(row, col) + noise * rng.normal(size=(10, *row.shape))
    images = prepare(frames, repeats, None, 1.0, (0.0, 0.0), (8, 40, 8, 80), mask_dust=False)
    found = measure(images, 16.0, 8.0, roughness=np.inf)
    scatter = found.coefficients - found.coefficients.mean(axis=0)
    n = 2 * len(found.basis_uv.nodes)
    precision = np.linalg.inv(found.covariance_one[:n, :n])
    squares = np.einsum("ti,ij,tj->", scatter[:, :n], precision, scatter[:, :n])
    # Known to √(2/(99·36)) = 2 %; a spline's slopes at its knots and between them differ by some
    # per cent here. White noise on the smoothed gradient would be 0.89 at half a pixel.
    assert squares / (99 * n) == pytest.approx(1.0, abs=0.08)
