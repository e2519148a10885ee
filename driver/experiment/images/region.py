"""Which pixels of the images are used, and why the others are not."""

from __future__ import annotations

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from driver.experiment.images.heightmaps import ImageError
from meshes.arrays import BoolArray

CodeArray = NDArray[np.uint8]
Bounds = tuple[float, float, float, float]

WALL = 2.0  # px; pixels as near to a trench wall interpolate heights that were not measured


class Excluded(IntEnum):
    """Why a pixel is not used; where several reasons hold, the largest."""

    USED = 0
    DUST = 1
    MASK = 2
    TRENCH = 3
    OUTSIDE = 4


def region_codes(
    valid: BoolArray,
    pixel: float,
    origin: tuple[float, float],
    bounds: Bounds,
    mask: BoolArray | None = None,
) -> CodeArray:
    """Return what becomes of each pixel: used, masked, too near to a trench, or outside the bounds.

    Args:
        valid: pixels that carry a height, shape (rows, cols).
        pixel: size of a pixel [µm].
        origin: (row, column) of X = 0, Y = 0.
        bounds: rectangle (x0, x1, y0, y1) of the face without its rim [µm].
        mask: pixels that may be used, shape (rows, cols); all if None.

    Returns:
        Values of `Excluded`, shape (rows, cols).

    Raises:
        ImageError: no pixel is left.
    """
    x = (np.arange(valid.shape[0]) - origin[0]) * pixel
    y = (np.arange(valid.shape[1]) - origin[1]) * pixel
    x0, x1, y0, y1 = bounds
    codes = np.zeros(valid.shape, dtype=np.uint8)
    if mask is not None:
        codes[~mask] = Excluded.MASK
    if not valid.all():
        codes[ndimage.distance_transform_edt(valid) <= WALL] = Excluded.TRENCH
    codes[~np.outer((x >= x0) & (x <= x1), (y >= y0) & (y <= y1))] = Excluded.OUTSIDE
    if (codes != Excluded.USED).all():
        raise ImageError(
            f"images.origin_pixel: found no pixel of the face (X {x0:.3g} to {x1:.3g}, Y {y0:.3g} "
            f"to {y1:.3g} µm) that carries a height and is in the mask, expected the face in the "
            f"field of view (X {x[0]:.3g} to {x[-1]:.3g}, Y {y[0]:.3g} to {y[-1]:.3g} µm)"
        )
    return codes
