"""Trace of the grain boundary on the measured face."""

from __future__ import annotations

import numpy as np

from driver.case.model import Case
from meshes.arrays import FloatArray


def boundary_trace(case: Case) -> FloatArray | None:
    """Return the ends (X, Y) of the trace of the grain boundary on the face [µm], shape (2, 2).

    None where there is no boundary or it is parallel to the loading axis.
    """
    point, normal = case.specimen.boundary_point_um, case.specimen.boundary_normal
    if point is None or normal is None or normal[1] == 0:
        return None
    x = case.specimen.width / 2 * np.array([-1.0, 1.0])
    y = point[1] - (normal[0] * (x - point[0]) - normal[2] * point[2]) / normal[1]
    return np.column_stack([x, y])
