"""The pattern that is fixed in the camera frame, from images of a flat surface."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from driver.images.heightmaps import ImageError
from driver.images.plane import plane_modes

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class FlatField:
    """Systematic height error of the instrument.

    Attributes:
        pattern: to be subtracted from every image [µm], shape (rows, cols).
        sigma: standard error of `pattern` at a pixel [µm].
    """

    pattern: FloatArray
    sigma: float


def flat_pattern(flats: Iterable[FloatArray]) -> FlatField:
    """Mean of images of a flat reference surface at random places, minus its best plane.

    Each frame loses its own plane first, so that a stage that tilts between the places does
    not count as scatter. One frame at a time is held (running mean and sum of squares).

    Args:
        flats: height maps [µm], each of shape (rows, cols); an array (n, rows, cols) will do.

    Raises:
        ImageError: fewer than two frames, or frames of unlike size.
    """
    n = 0
    for flat in flats:
        if n == 0:
            rows, cols = np.indices(flat.shape, dtype=np.float64).reshape(2, -1)
            planes = plane_modes(rows, cols)
            mean, squares, shape = np.zeros(flat.size), np.zeros(flat.size), flat.shape
        if flat.shape != shape:
            raise ImageError(f"flat frame {n}: shape {flat.shape}; expected {shape} as before.")
        n += 1
        level = flat.ravel() - planes @ (planes.T @ flat.ravel())
        change = level - mean
        mean += change / n
        squares += change * (level - mean)
    if n < 2:
        raise ImageError(f"flat frames: {n} given; at least 2 are needed for a standard error.")
    variance = squares.sum() / ((n - 1) * (mean.size - 3))
    return FlatField(pattern=mean.reshape(shape), sigma=float(np.sqrt(variance / n)))
