"""What interpolation between pixels leaves of the noise of an image in the motion it decides."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from scipy.sparse import csc_array, csr_array

from driver.common.splines.images import noise_autocorrelation
from meshes.arrays import FloatArray, IntArray

REACH = 5  # px; farther apart, interpolated noise shares less than 0.002 of its variance
_BINS = 32  # of the fraction of a pixel
_SPARED = 8  # one pixel in so many: the motion is smooth
_AT_A_TIME = 8192  # pixels, with all their neighbours


def noise_of_right_side(
    sensitivity: csr_array, rows: IntArray, cols: IntArray, shared: FloatArray, n_reference: int
) -> csc_array:
    """Covariance of the right-hand side b over that of white noise in one frame, σ² (1 + 1/n).

    b = Σ_i s_i ρ_i with s = ∇f·ψ. The noise of the reference is white: it gives M/n, with
    M = Σ s_i s_iᵀ. That of a frame is read between its pixels: interpolation smoothes it, and
    with r the mean of its autocorrelation over all frames and places it gives

        N = Σ_ij s_i s_jᵀ r(x_i − x_j),    N ≤ M, equal where the frames moved by whole pixels.

    The gradient of a series is that of the mean of its frames, read between pixels: smoothed
    as their noise is. White noise on it, σ² M⁻¹, would count that loss as one of sight.

    The result is (N + M/n)/(1 + 1/n), so that times σ² (1 + 1/n) it is that of one frame.

    Args:
        sensitivity: s at each pixel, shape (n_pix, n).
        rows: row of each pixel, shape (n_pix,).
        cols: column of each pixel, shape (n_pix,).
        shared: r by distance, of `mean_autocorrelation`.
        n_reference: number of images averaged into the reference.

    Returns:
        Symmetric, shape (n, n).
    """
    white = csc_array(sensitivity.T @ sensitivity)
    n_pix, size = sensitivity.shape
    pixel_of = np.full((np.ptp(rows) + 1 + 2 * REACH, np.ptp(cols) + 1 + 2 * REACH), -1)
    row, col = rows - rows.min() + REACH, cols - cols.min() + REACH
    pixel_of[row, col] = np.arange(n_pix)
    # Half of the neighbours: the other half gives the transpose.
    offsets = [
        (i, j) for i in range(REACH + 1) for j in range(-REACH, REACH + 1) if (i, j) > (0, 0)
    ]
    weights = np.array([shared[i, abs(j)] for i, j in offsets])
    half = csr_array((size, size))
    for first in range(0, n_pix, _AT_A_TIME):
        some = slice(first, first + _AT_A_TIME)
        other = np.stack([pixel_of[row[some] + i, col[some] + j] for i, j in offsets], axis=1)
        inside = other >= 0
        start = np.concatenate([[0], np.cumsum(inside.sum(axis=1))])
        value = np.broadcast_to(weights, other.shape)[inside]
        neighbours = csr_array((value, other[inside], start), shape=(len(other), n_pix))
        half = half + sensitivity[some].T @ (neighbours @ sensitivity)
    smoothed = shared[0, 0] * white + half + half.T
    return csc_array((smoothed + white / n_reference) / (1.0 + 1.0 / n_reference))


def noise_of_weights(
    weights: FloatArray, rows: IntArray, cols: IntArray, shared: FloatArray
) -> FloatArray:
    """Variance of Σ_i q_i ρ_i over σ² from the own noise of a frame: Σ_ij q_i q_j r(x_i − x_j).

    Args:
        weights: q at each pixel, shape (..., n_pix).
        rows: row of each pixel, shape (n_pix,).
        cols: column of each pixel, shape (n_pix,).
        shared: r by distance, of `mean_autocorrelation`.

    Returns:
        Shape (...).
    """
    # Its import takes a second, with scipy.stats, and few calls of prismid need it.
    from scipy.signal import oaconvolve

    every = np.concatenate([shared[:0:-1], shared])
    every = np.concatenate([every[:, :0:-1], every], axis=1)
    image = np.zeros((*weights.shape[:-1], np.ptp(rows) + 1, np.ptp(cols) + 1))
    image[..., rows - rows.min(), cols - cols.min()] = weights
    kernel = every[(None,) * (weights.ndim - 1)]
    spread = oaconvolve(image, kernel, mode="same", axes=(-2, -1))
    return np.asarray((image * spread).sum(axis=(-2, -1)))


def mean_autocorrelation(motion: Iterable[FloatArray]) -> FloatArray:
    """r, that of white noise read at the places of all frames, their mean.

    Args:
        motion: u, v of each frame [px], of shape (n_pix, 2 or more).

    Returns:
        By distance along rows and columns, shape (REACH + 1, REACH + 1).
    """
    count = np.zeros(_BINS**2, dtype=np.int64)
    for field in motion:
        shift = field[::_SPARED, :2]
        bins = np.rint(_BINS * (shift - np.floor(shift))).astype(np.int64) % _BINS
        count += np.bincount(_BINS * bins[:, 0] + bins[:, 1], minlength=_BINS**2)
    table = noise_autocorrelation(np.arange(_BINS) / _BINS, REACH)
    return np.asarray(table.T @ (count.reshape(_BINS, _BINS) / count.sum()) @ table)
