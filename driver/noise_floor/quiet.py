"""A reference without the noise that its images left in it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from driver.experiment.images.plane import plane_modes
from meshes.arrays import FloatArray

_BAND = 0.02  # cycles/px; width of a band of frequencies


def without_noise(
    heights: FloatArray, region: tuple[slice, slice], sigma: float, n: int
) -> FloatArray:
    """Return a reference with the power of its relief alone, at every frequency.

    White noise of n images gives each of the orthonormal cosine amplitudes the variance s² = σ²/n.
    Moved with the relief it would steepen the slopes by which motion is seen. Amplitudes of one
    frequency |k| of the mean power P are therefore multiplied by √(1 − s²/P), by 0 where P < s²:
    power subtraction, which unlike the filter of the least error keeps the power of the relief
    (Boll 1979, IEEE Trans. Acoust. 27, 113).

    Args:
        heights: the reference [µm], without gaps, shape (rows, columns).
        region: rows and columns from which the power is taken; its best plane does not count.
        sigma: noise of one image [µm].
        n: images averaged.
    """
    part = heights[region]
    rows, cols = np.indices(part.shape, dtype=np.float64).reshape(2, -1)
    plane = plane_modes(rows, cols)
    flat = part.ravel() - plane @ (plane.T @ part.ravel())
    power = fft.dctn(flat.reshape(part.shape), norm="ortho") ** 2
    band = _bands(part.shape).ravel()
    count = np.bincount(band)
    mean = np.bincount(band, power.ravel()) / np.maximum(count, 1)
    kept = np.sqrt(np.clip(1.0 - sigma**2 / n / np.maximum(mean, np.finfo(float).tiny), 0.0, 1.0))
    # Held beyond the last band of the region; a band without amplitudes takes its neighbours'.
    known = np.flatnonzero(count)
    gain = np.interp(_bands(heights.shape), known, kept[known])
    gain[0, 0] = 1.0
    return np.asarray(fft.idctn(gain * fft.dctn(heights, norm="ortho"), norm="ortho"))


def _bands(shape: tuple[int, ...]) -> NDArray[np.int64]:
    """Return the band of each cosine, by its cycles a pixel."""
    along = [np.arange(size) / (2 * size) for size in shape]
    return np.asarray(np.hypot(along[0][:, None], along[1]) / _BAND).astype(np.int64)
