"""Height noise from repeated images of one surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from driver.images.heightmaps import ImageError
from driver.images.plane import plane_modes

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True)
class Noise:
    """White height noise.

    Attributes:
        sigma: standard deviation of one pixel of one frame [µm].
        dof: degrees of freedom behind it; sigma is known to sigma/√(2 dof).
    """

    sigma: float
    dof: int


def noise_from_repeats(repeats: FloatArray, mask: BoolArray) -> Noise:
    """Scatter of repeated images about their mean, offset and tilt of each frame removed.

    The stage may move in height and tilt between two repeats: three of the pixels' degrees
    of freedom go to a plane in each frame, whether it is significant or not.

    Args:
        repeats: height maps of one surface [µm], shape (n, rows, cols).
        mask: pixels to use, shape (rows, cols).

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
    dof = (n - 1) * (n_pixels - 3)
    return Noise(sigma=float(np.sqrt((scatter**2).sum() / dof)), dof=dof)
