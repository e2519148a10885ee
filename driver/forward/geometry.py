"""Grains and their boundaries on the measured face."""

from __future__ import annotations

import numpy as np

from driver.case.model import Case
from driver.case.user_mesh import mesh_of_file
from driver.experiment.labels import columns_of_case
from meshes.arrays import FloatArray
from meshes.prism_mesh import PrismMesh
from meshes.surface_grains import middles_of_grains, segments_between_grains


def boundary_traces(case: Case) -> FloatArray:
    """Return the ends (X, Y) of the trace of each grain boundary on the face [µm].

    Those parallel to the loading axis have none. On a mesh of the user's own, and of labels, a
    trace is in as many straight parts as it has.

    Returns:
        traces in the order of the grains, shape (n, 2, 2).
    """
    mesh, columns = _mesh(case), columns_of_case(case)
    if mesh is not None:
        return segments_between_grains(mesh)
    if columns is not None:
        parts = [np.stack([line[:-1], line[1:]], axis=1) for line in columns.lines]
        return np.concatenate([np.zeros((0, 2, 2)), *parts])
    x = case.specimen.width / 2 * np.array([-1.0, 1.0])
    traces = []
    for boundary in case.specimen.planes:
        point, normal = boundary.point, boundary.normal
        if normal[1] != 0:
            y = point[1] - (normal[0] * (x - point[0]) - normal[2] * point[2]) / normal[1]
            traces.append(np.column_stack([x, y]))
    return np.reshape(traces, (len(traces), 2, 2))


def grain_places(case: Case) -> list[tuple[int, FloatArray]]:
    """Return the grains that reach the face, from 0, with a place X, Y of each [µm]."""
    mesh, columns = _mesh(case), columns_of_case(case)
    if mesh is not None:
        return middles_of_grains(mesh)
    if columns is not None:
        return columns.middles(case.specimen.width, case.specimen.length)
    specimen, traces = case.specimen, boundary_traces(case)
    if len(case.grains) == 1:
        return [(0, np.array([0.0, specimen.length / 2]))]
    if len(traces) != len(specimen.planes) or not len(traces):
        return []
    ends = [0.0, *sorted(float(trace[:, 1].mean()) for trace in traces), specimen.length]
    count = len(ends) - 1
    along_y = specimen.planes[0].normal[1] > 0
    return [
        (k if along_y else count - 1 - k, np.array([0.0, (ends[k] + ends[k + 1]) / 2]))
        for k in range(count)
    ]


def _mesh(case: Case) -> PrismMesh | None:
    """Return the mesh of the user's own, None of another shape."""
    name = case.specimen.mesh_file
    return None if name is None else mesh_of_file(case.path(name))
