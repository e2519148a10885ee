"""Frames that show the surface, but not as the series says: mirrored, exchanged, far away."""

from __future__ import annotations

from itertools import combinations
from typing import Literal

import numpy as np
from scipy import fft, ndimage

from meshes.arrays import BoolArray, FloatArray, IntArray

Turned = Literal["mirrored along X", "mirrored along Y", "turned by 180°"]

# What both maps have in common is looked for between these lengths [px]: not in the noise of
# pixels, nor in the outline of the specimen, which may well be symmetric.
_FINEST, _COARSEST = 1.0, 4.0
_WALL = 3.0  # of the usual relief, beyond which walls and dust do not count
_ROBUST = 1.4826  # standard deviation of a normal distribution over its median deviation
_ALIKE = 0.3  # correlation of two maps of one surface at least
_CLEARLY = 2.0  # and so much more than as the frame is stored
_OFF = 5.0  # σ by which a frame has to lie off its neighbours to be looked at
_LOOKED_AT = 24  # frames, all pairs of which are tried
_FAR, _UNUSUAL = 10.0, 5.0  # px of a jump, and how many usual steps


def turned(reference: FloatArray, frame: FloatArray, region: BoolArray) -> Turned | None:
    """How a frame shows the reference: not as it is, but mirrored or turned.

    The largest correlation over all shifts is compared, of the frame and of its three reflections.

    Args:
        reference: heights without gaps [µm], rows along X and columns along Y, shape (rows, cols).
        frame: the same of the frame.
        region: pixels of the reference that are looked for, shape (rows, cols).

    Returns:
        None where the frame shows it as it is, or something else.
    """
    wanted = np.where(region, _band(reference), 0.0)
    ways: dict[Turned, FloatArray] = {
        "mirrored along X": frame[::-1],
        "mirrored along Y": frame[:, ::-1],
        "turned by 180°": frame[::-1, ::-1],
    }
    likeness = {way: _likeness(wanted, _band(seen)) for way, seen in ways.items()}
    best = max(likeness, key=lambda way: likeness[way])
    least = max(_ALIKE, _CLEARLY * _likeness(wanted, _band(frame)))
    return best if likeness[best] > least else None


def _band(heights: FloatArray) -> FloatArray:
    """Relief between both lengths, of about the same variance everywhere."""
    fine = ndimage.gaussian_filter(heights, _FINEST) - ndimage.gaussian_filter(heights, _COARSEST)
    usual = _ROBUST * float(np.median(np.abs(fine)))
    if usual == 0.0:
        return np.zeros_like(fine)
    fine = np.clip(fine, -_WALL * usual, _WALL * usual)
    return np.asarray(fine / np.sqrt(ndimage.gaussian_filter(fine**2, _COARSEST) + usual**2))


def _likeness(wanted: FloatArray, seen: FloatArray) -> float:
    """Largest correlation over all shifts of a part of one map, 0 elsewhere, with another map."""
    shape = [
        fft.next_fast_len(a + b - 1, True) for a, b in zip(wanted.shape, seen.shape, strict=True)
    ]
    product = fft.irfft2(np.conj(fft.rfft2(wanted, shape)) * fft.rfft2(seen, shape), shape)
    seen_there = np.sqrt(np.mean(seen**2) * np.count_nonzero(wanted))
    norm = float(np.linalg.norm(wanted) * seen_there)
    return float(product.max()) / norm if norm else 0.0


def exchanged(
    elongation: FloatArray, stage: FloatArray, sigma: float, kept: BoolArray
) -> list[tuple[int, int]]:
    """Return pairs of frames each of which has the elongation that the other should have.

    A frame between two others is held against the line through them along the stage travel. A pair
    is named where both, exchanged, lie on such lines as well as the other frames do.

    Args:
        elongation: of each image [µm], shape (T,).
        stage: stage travel at each image [µm], shape (T,).
        sigma: noise of an elongation that images do not share [µm].
        kept: images that were followed, shape (T,).
    """
    frames, pairs = np.flatnonzero(kept), list[tuple[int, int]]()
    value, travel = elongation[frames].copy(), stage[frames]
    if frames.size < 6:
        return pairs
    usual = 1.0
    for _ in range(frames.size // 2):
        off = np.abs(_off_line(value, travel, sigma))
        usual = max(1.0, _ROBUST * float(np.nanmedian(off)))
        bad = np.flatnonzero(off > _OFF * usual)
        near = np.unique(np.clip(np.concatenate([bad - 1, bad, bad + 1]), 0, frames.size - 1))
        if bad.size == 0 or near.size > _LOOKED_AT:
            return pairs
        best = _best_exchange(value, travel, sigma, near, _OFF * usual)
        if best is None:
            return pairs
        i, j = best
        value[[i, j]] = value[[j, i]]
        pairs.append((int(frames[i]), int(frames[j])))
    return pairs


def _best_exchange(
    value: FloatArray, travel: FloatArray, sigma: float, near: IntArray, limit: float
) -> tuple[int, int] | None:
    """Return the exchange that leaves least off the lines, if it leaves nothing beside them."""
    best, least = None, float(np.nansum(_off_line(value, travel, sigma) ** 2))
    for i, j in combinations(near.tolist(), 2):
        other = value.copy()
        other[[i, j]] = other[[j, i]]
        off = _off_line(other, travel, sigma)
        around = np.clip([i - 1, i, i + 1, j - 1, j, j + 1], 0, value.size - 1)
        left = float(np.nansum(off**2))
        if left < least and np.nanmax(np.abs(off[around]), initial=0.0) <= limit:
            best, least = (i, j), left
    return best


def _off_line(value: FloatArray, travel: FloatArray, sigma: float) -> FloatArray:
    """Distance from the line through both neighbours, over its noise; NaN at turns and ends."""
    before, at, after = travel[:-2], travel[1:-1], travel[2:]
    span = after - before
    share = np.divide(at - before, span, out=np.full(span.shape, np.nan), where=span != 0)
    share[(share < 0) | (share > 1)] = np.nan
    line = (1.0 - share) * value[:-2] + share * value[2:]
    noise = sigma * np.sqrt(1.0 + (1.0 - share) ** 2 + share**2)
    return np.concatenate([[np.nan], (value[1:-1] - line) / noise, [np.nan]])


def jumps(shift: FloatArray, kept: BoolArray) -> list[tuple[int, FloatArray]]:
    """Frames that lie far from the one before, and by how much [px], along X and Y.

    Args:
        shift: mean motion of each frame [px], along X and Y, shape (T, 2).
        kept: frames that were followed, shape (T,).
    """
    frames = np.flatnonzero(kept)
    steps = np.diff(shift[frames], axis=0)
    size = np.hypot(*steps.T)
    limit = max(_FAR, _UNUSUAL * float(np.median(size))) if size.size else _FAR
    return [(int(frames[t + 1]), steps[t]) for t in np.flatnonzero(size > limit)]
