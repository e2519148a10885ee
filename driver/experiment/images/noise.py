"""Height noise from repeated images of one surface, and from the residuals of a series."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from driver.common.distributions import chi2_isf
from driver.experiment.images.heightmaps import ImageError
from driver.experiment.images.plane import plane_modes
from meshes.arrays import BoolArray, FloatArray

# Squares of second differences of white noise are correlated: k of them, from k + 2 frames, have
# the scatter of k/(1 + 2 (4/6)² + 2 (1/6)²) independent ones.
_SHARED = 1.0 + 2.0 * ((4 / 6) ** 2 + (1 / 6) ** 2)
FITTED = 0.95  # share of a pixel's variance in the motion, beyond which its residual says nothing
CHANCE = 0.01  # of one pixel or more that is called noisier in a series of uniform noise


@dataclass(frozen=True)
class Noise:
    """White height noise.

    Attributes:
        sigma: standard deviation of one pixel of one frame [µm].
        dof: degrees of freedom behind it; sigma is known to sigma/√(2 dof). 0 where it is stated.
    """

    sigma: float
    dof: int


def noise_from_repeats(repeats: FloatArray, mask: BoolArray, n_shifts: int = 0) -> Noise:
    """Scatter of repeated images about their mean, offset and tilt of each frame removed.

    The stage may move in height and tilt between two repeats: three of the pixels' degrees
    of freedom go to a plane in each frame, whether it is significant or not.

    Args:
        repeats: height maps of one surface [µm], shape (n, rows, cols).
        mask: pixels to use, shape (rows, cols).
        n_shifts: further motions of each frame that were fitted to these pixels.

    Raises:
        ImageError: fewer than two repeats, fewer than four pixels, or identical repeats.
    """
    n, n_pixels = len(repeats), int(mask.sum())
    if n < 2 or n_pixels < 4:
        raise ImageError(
            f"repeats: {n} frames of {n_pixels} usable pixels; at least 2 of 4 are needed."
        )
    rows, cols = np.nonzero(mask)
    planes = plane_modes(rows.astype(np.float64), cols.astype(np.float64))
    scatter = repeats[:, rows, cols]
    if np.array_equal(scatter[1:], scatter[:-1]):
        raise ImageError("repeats: all frames are identical; the noise cannot be measured.")
    scatter = scatter - scatter.mean(axis=0)
    scatter -= (scatter @ planes) @ planes.T
    dof = (n - 1) * (n_pixels - 3 - n_shifts)
    return Noise(sigma=float(np.sqrt((scatter**2).sum() / dof)), dof=dof)


@dataclass(frozen=True, eq=False)
class TemporalNoise:
    """Height noise from what a series of residuals does from one frame to the next.

    Attributes:
        sigma: standard deviation of one pixel of one frame, over all pixels [µm].
        dof: degrees of freedom behind it.
        map: the same at each pixel [µm], shape (n_pix,).
        map_dof: degrees of freedom behind each value of the map.
        larger: pixels where it is larger than `sigma`, beyond chance, shape (n_pix,).
    """

    sigma: float
    dof: float
    map: FloatArray
    map_dof: float
    larger: BoolArray


def temporal_noise(
    series: Iterable[tuple[FloatArray, FloatArray]], fitted: FloatArray
) -> TemporalNoise | None:
    """Noise from the second differences of the residuals in time.

    A pixel's share of the reference is the same in every frame, and what a model leaves grows
    slowly: both fall out of ρ(t−1) − 2 ρ(t) + ρ(t+1), whose variance is that of six readings.

    Args:
        series: of each frame in its order ρ [µm], NaN where it lacks a pixel, and the variance
            of interpolated white noise at the pixels, both of shape (n_pix,).
        fitted: share of the variance of each pixel that the fitted motion takes, shape
            (n_pix,).

    Returns:
        None for fewer than three frames with a pixel in common.
    """
    count, total = np.zeros(fitted.size, dtype=np.int64), np.zeros(fitted.size)
    last: list[tuple[FloatArray, FloatArray]] = []
    n_differences = 0
    for third in series:
        if len(last) == 2:
            n_differences += 1
            (first, gain_first), (second, gain_second) = last
            difference = first - 2.0 * second + third[0]
            scale = gain_first + 4.0 * gain_second + third[1]
            seen = np.isfinite(difference) & (fitted < FITTED)
            count += seen
            total[seen] += difference[seen] ** 2 / scale[seen]
        last = [*last[-1:], third]
    if not count.any():
        return None
    total /= np.maximum(1.0 - fitted, 1.0 - FITTED)
    mean = float(total.sum() / count.sum())
    variance = np.where(count > 0, total / np.maximum(count, 1), mean)
    map_dof = n_differences / _SHARED
    own = np.maximum(count, 1) / _SHARED
    limit = chi2_isf(CHANCE / variance.size, own) / own
    return TemporalNoise(
        sigma=float(np.sqrt(mean)),
        dof=map_dof * float(variance.size - fitted.sum()),
        map=np.sqrt(variance),
        map_dof=map_dof,
        larger=np.asarray(variance > limit * mean),
    )
