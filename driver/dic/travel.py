"""Smoothing of a measured motion along stage travel, and what it does to the covariance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from driver.images.heightmaps import ImageError

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Smoothed:
    """Nodal values smoothed from image to image.

    Attributes:
        coefficients: S p, shape (T, n).
        smoother: S, the same for every nodal value, shape (T, T). A motion that is piecewise
            linear in travel passes unchanged.
        covariance_in_time: S (I + 11ᵀ/n_reference) Sᵀ, shape (T, T): the covariance of value i
            in image t and value j in image t' is covariance_one[i, j] times its entry t, t'.
    """

    coefficients: FloatArray
    smoother: FloatArray
    covariance_in_time: FloatArray


def smooth_along_travel(
    coefficients: FloatArray,
    travel: FloatArray,
    length: float,
    n_reference: int,
    turning_points: NDArray[np.int64] | None = None,
) -> Smoothed:
    """Penalise the change of slope against stage travel between two turning points.

    S = (I + DᵀD)⁻¹ with D the second divided differences of neighbouring images times length²,
    none of them across a turning point. What oscillates over 2π·length of travel is halved; the
    noise of one image falls by the diagonal of S Sᵀ, and neighbours become correlated.

    Args:
        coefficients: nodal values of each image, shape (T, n).
        travel: of the stage at each image [µm], shape (T,); two images at one place are only
            allowed at a turning point.
        length: of travel [µm] below which changes count as noise.
        n_reference: number of images averaged into the reference.
        turning_points: images at which the loading turns; found where the travel turns if None.

    Raises:
        ImageError: sizes that differ, a length that is not positive, or an image without travel.
    """
    n = len(coefficients)
    if travel.shape != (n,):
        raise ImageError(f"travel of shape {travel.shape}, but there are {n} images.")
    if not (np.isfinite(length) and length > 0):
        raise ImageError(f"length = {length} µm; a positive stage travel is expected.")
    steps = np.diff(travel)
    if turning_points is None:
        turning_points = 1 + np.flatnonzero(np.sign(steps[1:]) != np.sign(steps[:-1]))
    rows = []
    for t in np.setdiff1d(np.arange(1, n - 1), turning_points):
        before, after = abs(steps[t - 1]), abs(steps[t])
        if not (before > 0 and after > 0):
            raise ImageError(f"image {t}: the stage did not travel between it and a neighbour.")
        row = np.zeros(n)
        row[t - 1 : t + 2] = [1 / before, -1 / before - 1 / after, 1 / after]
        rows.append(row * 2 / (before + after) * length**2)
    bends = np.array(rows).reshape(-1, n)
    smoother = np.linalg.inv(np.eye(n) + bends.T @ bends)
    once = np.eye(n) + np.ones((n, n)) / n_reference
    return Smoothed(
        coefficients=smoother @ coefficients,
        smoother=smoother,
        covariance_in_time=smoother @ once @ smoother.T,
    )
