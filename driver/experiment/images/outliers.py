"""Frames of a series that are unlike their neighbours."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from driver.common.distributions import t_isf
from driver.experiment.images.reference import Reference
from driver.experiment.images.rigid import shift_between
from driver.experiment.images.spikes import NORMAL
from meshes.arrays import BoolArray, FloatArray

NEIGHBOURS = 10  # half of them may be outliers themselves
FEWEST = 12  # frames, below which a spread says too little
CHANCE = 0.01  # of naming one frame or more of a series without outliers
_EFFICIENCY = 0.37  # of the median absolute deviation of normal numbers
# What does not matter is not named, however regular the others are.
RATIO = 1.1
SHIFT = 1.0  # px
HEIGHT = 0.1  # µm

RESIDUAL, NOISE = "residual", "noise"


@dataclass(frozen=True)
class Outlier:
    """A frame that is unlike its neighbours.

    Attributes:
        frame: its number.
        what: the quantity that gives it away.
        found: its value.
        usual: median of its neighbours.
        unit: of both.
    """

    frame: int
    what: str
    found: float
    usual: float
    unit: str

    def __str__(self) -> str:
        unit = f" {self.unit}" if self.unit else ""
        return (
            f"{self.what} {self.found:.3g}{unit} where its neighbours have {self.usual:.3g}{unit}"
        )


@dataclass(frozen=True, eq=False)
class FrameStatistics:
    """What tells frames apart before they are correlated.

    Attributes:
        shift: rigid motion against the reference [µm], along X, Y, Z, shape (T, 3).
        residual: what is left of the heights after it, root mean square [µm], shape (T,).
        noise: roughness of the frame from one pixel to the next [µm], shape (T,).
    """

    shift: FloatArray
    residual: FloatArray
    noise: FloatArray


def frame_statistics(
    frames: Iterable[FloatArray], reference: Reference, pixel: float
) -> FrameStatistics:
    """Rigid motion, residual and noise of each frame.

    Args:
        frames: corrected height maps without gaps [µm], each of shape (rows, cols).
        reference: the reference surface.
        pixel: size of a pixel [µm].
    """
    region = reference.region
    rows, cols = np.nonzero(region)
    still = reference.heights[region]
    shifts, residuals, noises = [], [], []
    for frame in frames:
        shift = shift_between(reference.heights, frame, pixel, region)
        at = [rows + shift.dx / pixel, cols + shift.dy / pixel]
        moved = ndimage.map_coordinates(frame, at, mode="mirror")
        shifts.append(shift)
        residuals.append(np.sqrt(np.mean((still + shift.dz - moved) ** 2)))
        noises += noise_levels([frame], region).tolist()
    return FrameStatistics(np.array(shifts), np.array(residuals), np.array(noises))


def noise_levels(frames: Iterable[FloatArray], region: BoolArray) -> FloatArray:
    """White noise of each frame, with what relief has left of second differences, shape (T,).

    The mixed second difference of white noise has 36 times its variance.

    Args:
        frames: height maps without gaps [µm], each of shape (rows, cols).
        region: pixels to look at, shape (rows, cols).
    """
    bend = np.outer([1.0, -2.0, 1.0], [1.0, -2.0, 1.0]) / 6.0
    inside = ndimage.binary_erosion(region, np.ones((3, 3)))
    return np.array([
        np.sqrt(np.mean(ndimage.convolve(frame, bend)[inside] ** 2)) for frame in frames
    ])  # fmt: skip


def find_outliers(
    residual: FloatArray, noise: FloatArray, shift: FloatArray, pixel: float, unit: str
) -> tuple[Outlier, ...]:
    """Name the frames whose residual, noise or shift is unlike that of their neighbours.

    A slow change is no outlier, nor is a step that lasts: each value is held against a robust
    line through its neighbours, and against the medians of the ones before and of the ones
    after. The spread of the differences is their median absolute deviation, which a few
    outliers do not move; with T frames it has about 0.37 T degrees of freedom. A difference
    counts beyond Student's t of those, at a chance of `CHANCE` for the series, and where it
    matters (`RATIO`, `SHIFT`, `HEIGHT`).

    Args:
        residual: size of the residual of each frame, in a unit of its own, shape (T,).
        noise: noise of each frame [µm], shape (T,).
        shift: rigid motion of each frame [µm], shape (T, 3).
        pixel: size of a pixel [µm].
        unit: unit of `residual`.

    Returns:
        In the order of the frames; nothing for fewer than `FEWEST` frames.
    """
    if residual.size < FEWEST:
        return ()
    ratio = float(np.log(RATIO))
    outliers: list[Outlier] = []
    for what, value, floor, of in (
        (RESIDUAL, residual, ratio, unit),
        (NOISE, 1e3 * noise, ratio, "nm"),
        ("shift along X", shift[:, 0] / pixel, SHIFT, "px"),
        ("shift along Y", shift[:, 1] / pixel, SHIFT, "px"),
        ("shift along Z", 1e3 * shift[:, 2], 1e3 * HEIGHT, "nm"),
    ):
        relative = floor == ratio
        compared = np.log(np.maximum(value, np.finfo(float).tiny)) if relative else value
        distance, usual, limit = _unlike(compared)
        for t in np.flatnonzero(distance > max(limit, floor)):
            if _beside(compared, int(t)) <= max(limit, floor):
                continue  # a step that lasts
            expected = float(np.exp(usual[t]) if relative else usual[t])
            if what == RESIDUAL and value[t] < expected:
                continue  # a good frame
            outliers.append(Outlier(int(t), what, float(value[t]), expected, of))
    return tuple(sorted(outliers, key=lambda outlier: outlier.frame))


def without(reference: BoolArray, outliers: Sequence[Outlier]) -> tuple[Outlier, ...]:
    """Return outliers less those of frames that are the reference, shape (T,)."""
    return tuple(outlier for outlier in outliers if not reference[outlier.frame])


def texts_by_frame(outliers: Sequence[Outlier]) -> dict[int, str]:
    """Return what is unlike in each frame that was named, by its number."""
    lines: dict[int, list[str]] = {}
    for outlier in outliers:
        lines.setdefault(outlier.frame, []).append(str(outlier))
    return {frame: ", ".join(texts) for frame, texts in lines.items()}


def left_out(outliers: Sequence[Outlier], n_frames: int) -> BoolArray:
    """Frames whose images are not fitted: those whose residual is too large, shape (T,).

    A frame that only moved further, or is noisier within what its residual shows, is measured
    as well as the others.
    """
    frames = [outlier.frame for outlier in outliers if outlier.what == RESIDUAL]
    return np.asarray(np.isin(np.arange(n_frames), frames))


def _usual(value: FloatArray) -> FloatArray:
    """Return what the nearest neighbours of each value let expect: a line of Theil and Sen."""
    n, frames = value.size, np.arange(value.size)
    start = np.clip(frames - NEIGHBOURS // 2, 0, n - NEIGHBOURS - 1)
    around = start[:, None] + np.arange(NEIGHBOURS + 1)
    around = around[around != frames[:, None]].reshape(n, NEIGHBOURS)
    there, away = value[around], around - frames[:, None]
    i, j = np.triu_indices(NEIGHBOURS, 1)
    slope = np.median((there[:, j] - there[:, i]) / (away[:, j] - away[:, i]), axis=1)
    return np.asarray(np.median(there - slope[:, None] * away, axis=1))


def _beside(value: FloatArray, t: int) -> float:
    """Distance from the median of the neighbours before or after, whichever is the nearer."""
    half = NEIGHBOURS // 2
    sides = value[max(0, t - half) : t], value[t + 1 : t + 1 + half]
    return min(abs(float(value[t] - np.median(side))) for side in sides if side.size)


def _unlike(value: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """How far each value is from what is usual there, that, and the limit by chance alone."""
    usual = _usual(value)
    distance = np.abs(value - usual)
    threshold = t_isf(CHANCE / 2 / value.size, _EFFICIENCY * value.size)
    return distance, usual, float(threshold * NORMAL * np.median(distance))
