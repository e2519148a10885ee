"""Traces of the grain boundaries on the measured face."""

from __future__ import annotations

import numpy as np

from driver.case.model import Case
from meshes.arrays import FloatArray


def boundary_traces(case: Case) -> FloatArray:
    """Return the ends (X, Y) of the trace of each grain boundary on the face [µm].

    Those parallel to the loading axis have none.

    Returns:
        traces in the order of the grains, shape (n, 2, 2).
    """
    x = case.specimen.width / 2 * np.array([-1.0, 1.0])
    traces = []
    for boundary in case.specimen.planes:
        point, normal = boundary.point, boundary.normal
        if normal[1] != 0:
            y = point[1] - (normal[0] * (x - point[0]) - normal[2] * point[2]) / normal[1]
            traces.append(np.column_stack([x, y]))
    return np.reshape(traces, (len(traces), 2, 2))
