"""What part of the images the meshes of correlation cover."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from driver.experiment.images.heightmaps import ImageError
from driver.experiment.images.region import Bounds
from meshes.arrays import BoolArray
from meshes.plane_mesh import PlaneMesh


def within(meshes: Sequence[PlaneMesh], bounds: Bounds) -> Bounds:
    """Return the part of a rectangle (x0, x1, y0, y1) [µm] in the boxes around all meshes.

    Raises:
        ImageError: nothing is left of it.
    """
    x0, x1, y0, y1 = bounds
    for mesh in meshes:
        (left, low), (right, high) = mesh.points.min(axis=0), mesh.points.max(axis=0)
        x0, x1, y0, y1 = max(x0, left), min(x1, right), max(y0, low), min(y1, high)
        if x0 >= x1 or y0 >= y1:
            raise ImageError(
                f"dic.mesh, dic.height_mesh: found a mesh over X {left:.4g} to {right:.4g}, "
                f"Y {low:.4g} to {high:.4g} µm, expected one that covers the measured face or a "
                f"part of it (X {bounds[0]:.4g} to {bounds[1]:.4g}, Y {bounds[2]:.4g} to "
                f"{bounds[3]:.4g} µm)"
            )
    return float(x0), float(x1), float(y0), float(y1)


def pixels_on(
    meshes: Sequence[PlaneMesh],
    shape: tuple[int, ...],
    pixel: float,
    origin: tuple[float, float],
) -> BoolArray:
    """Pixels of an image that lie in all meshes, shape (rows, cols).

    Args:
        meshes: in the specimen frame [µm].
        shape: (rows, cols) of an image.
        pixel: its size [µm].
        origin: (row, column) of X = 0, Y = 0.
    """
    xy = (np.indices(shape).reshape(2, -1).T - np.array(origin)) * pixel
    inside = np.ones(len(xy), dtype=bool)
    for mesh in meshes:
        inside &= mesh.locate(xy)[0] >= 0
    return inside.reshape(shape)
