"""The pattern that is fixed in the camera frame, from images of a flat surface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy import fft, ndimage

from driver.common.splines.images import SplineImages, spline_images
from driver.experiment.images.heightmaps import HeightMaps, ImageError, fill_off_surface, on_surface
from driver.experiment.images.plane import plane_modes
from driver.experiment.images.spikes import NORMAL
from meshes.arrays import BoolArray, FloatArray

# Robust standard deviations beyond which a pixel of a flat is dirt: of 400 flats of 300 000
# pixels noise alone loses 70 readings, nothing to the mean.
DIRT = 5.0
_NEIGHBOURS = 9  # orders along each axis over which the power of a pattern's cosines is averaged
_REACH = 16  # px, beyond which the cardinal spline is below 1e-9
_BAND = 32  # rows that are looked at together in all flats, to bound the memory


@dataclass(frozen=True, eq=False)
class FlatField:
    """Systematic height error of the instrument.

    Attributes:
        pattern: to be subtracted from every image [µm], shape (rows, cols).
        sigma: standard error of `pattern`, root mean square over the pixels of two
            flats or more [µm].
        error: standard error of `pattern` at each pixel [µm], shape (rows, cols); with n
            flats it is known to 1/√(2 (n − 1)) of itself.
        n: number of flats.
    """

    pattern: FloatArray
    sigma: float
    error: FloatArray
    n: int


def flat_pattern(flats: HeightMaps | Sequence[FloatArray]) -> FlatField:
    """Mean of images of a flat reference surface at random places, minus its best plane.

    Each frame loses its own plane first, so that a stage that tilts between the places does
    not count as scatter. Readings that are no number or that dirt spoils do not enter the mean
    of their pixel.

    Args:
        flats: height maps [µm], each of shape (rows, cols).

    Raises:
        ImageError: fewer than two frames, frames of unlike size, or one without heights.
    """
    n = len(flats)
    if n < 2:
        raise ImageError(f"flat frames: {n} given; at least 2 are needed for a standard error.")
    # In one piece, which goes back to the machine as a whole.
    levelled = np.empty((n, *flats[0].shape))
    whole: FloatArray | None = None
    for k, flat in enumerate(flats):
        if flat.shape != levelled.shape[1:]:
            raise ImageError(
                f"flat frame {k}: shape {flat.shape}; expected {levelled.shape[1:]} as before."
            )
        valid = on_surface(flat)
        if not valid.any():
            raise ImageError(f"flat frame {k}: no pixel carries a height.")
        if valid.all():
            whole = _planes(valid) if whole is None else whole
            levelled[k] = _without_plane(flat, valid, whole)
        else:
            levelled[k] = _without_plane(flat, valid, _planes(valid))
    mean, squares, count = _statistics(levelled)
    known = count >= 2
    # A plane of three parameters was taken from every frame.
    variance = squares / np.maximum(count - 1, 1) / (1.0 - 3.0 / mean.size)
    mean = _without_plane(mean, known, _planes(known))
    error = np.sqrt(variance / np.maximum(count, 1))
    # Where no two flats have a height the pattern is that of the neighbours, and as uncertain
    # as it is large.
    error[~known] = mean[known].std()
    return FlatField(
        pattern=fill_off_surface(mean, known),
        sigma=float(np.sqrt(np.mean(error[known] ** 2))),
        error=error,
        n=n,
    )


def without_noise(flat: FlatField) -> FloatArray:
    """Return the pattern without the noise of its flats [µm], shape (rows, cols).

    Wiener filter: each cosine over the image is reduced to the share of its power that is no
    noise, the power being the mean about it. What is subtracted from the images stays the mean of
    the flats; but a pattern that shifts with a frame has the slopes of its noise as well, and of n
    flats those soon exceed its own.
    """
    cosines = fft.dctn(flat.pattern, norm="ortho")
    power = ndimage.uniform_filter(cosines**2, _NEIGHBOURS)
    own = np.maximum(power - flat.sigma**2, 0.0)
    share = np.divide(own, power, out=np.zeros_like(own), where=power > 0)
    return np.asarray(fft.idctn(share * cosines, norm="ortho"))


def left_over(displacement: FloatArray, gain: FloatArray) -> FloatArray:
    """Variance that the error e of the pattern leaves in ρ = f + w − g(x + u), in units of e's.

    Both images carry it: ρ has e(x + u) − e(x), interpolated at x + u. With η the cardinal
    spline its variance is 1 + gain − 2 η(u) η(v): none without motion, since the pattern is
    fixed in the camera frame, and nearly 2 beyond a pixel.

    Args:
        displacement: u, v [pixels], shape (..., 2).
        gain: variance of interpolated white noise at x + u, shape (...).
    """
    u, v = (np.clip(displacement[..., axis], -_REACH, _REACH) for axis in (0, 1))
    return np.asarray(1.0 + gain - 2.0 * _cardinal().value(0, u, v))


@cache
def _cardinal() -> SplineImages:
    """Return η(u) η(v), the cubic spline that is 1 at the origin and 0 at every other pixel."""
    delta = np.zeros((1, 2 * _REACH + 1, 2 * _REACH + 1))
    delta[0, _REACH, _REACH] = 1.0
    return spline_images(delta, 1.0, (float(_REACH), float(_REACH)))


def _planes(valid: BoolArray) -> FloatArray:
    rows, cols = np.nonzero(valid)
    return plane_modes(rows.astype(np.float64), cols.astype(np.float64))


def _without_plane(heights: FloatArray, valid: BoolArray, planes: FloatArray) -> FloatArray:
    result = np.full_like(heights, np.nan)
    result[valid] = heights[valid] - planes @ (planes.T @ heights[valid])
    return result


def _statistics(levelled: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Mean, sum of squares about it, and number of the readings of each pixel without dirt."""
    shape = levelled.shape[1:]
    bands = [np.s_[top : top + _BAND] for top in range(0, shape[0], _BAND)]
    medians, own = np.empty(shape), np.empty(shape)
    for rows in bands:
        stack = levelled[:, rows]
        medians[rows] = _median(stack)
        own[rows] = NORMAL * _median(np.abs(stack - medians[rows]))
    # A pixel may be noisier than the others: its own readings say how much it scatters, and
    # those of all pixels where it has too few of them.
    limit = DIRT * np.fmax(own, np.nanmedian(own))
    mean, squares, count = np.empty(shape), np.empty(shape), np.empty(shape)
    for rows in bands:
        stack = levelled[:, rows]
        finite = np.isfinite(stack)
        clean = finite & (np.abs(stack - medians[rows]) <= limit[rows])
        # Of two readings that differ neither is known to be the wrong one.
        few = clean.sum(axis=0) < 2
        clean[:, few] = finite[:, few]
        count[rows] = clean.sum(axis=0)
        mean[rows] = np.sum(stack, axis=0, where=clean) / np.maximum(count[rows], 1)
        squares[rows] = np.sum((stack - mean[rows]) ** 2, axis=0, where=clean)
    return mean, squares, count


def _median(stack: FloatArray) -> FloatArray:
    """Median of each pixel over the frames; no number where none has one."""
    if np.isfinite(stack).all():
        return np.asarray(np.median(stack, axis=0))
    seen = np.isfinite(stack).any(axis=0)
    result = np.full(stack.shape[1:], np.nan)
    result[seen] = np.nanmedian(stack[:, seen], axis=0)
    return result
