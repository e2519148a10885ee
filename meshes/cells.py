"""What tet10 and wedge15 cells have in common, by their number of nodes."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from meshes import tet10, wedge15
from meshes.arrays import FloatArray, IntArray

EDGES: Mapping[int, IntArray] = MappingProxyType({10: tet10.EDGES, 15: wedge15.EDGES})
"""Corners joined by the edges that carry the nodes after the corners."""

# Reference gradients of the shape functions at the corners and the centre.
_GRADIENTS = {
    10: tet10.shape_functions(tet10.CHECKED)[1],
    15: wedge15.shape_functions(wedge15.CHECKED)[1],
}


def jacobians(points: FloatArray, cells: IntArray) -> FloatArray:
    """Jacobian determinant of the quadratic map of each cell at its corners and its centre.

    Args:
        points: node coordinates [µm], shape (n_nodes, 3).
        cells: connectivity in VTK order, shape (n_cells, 10) or (n_cells, 15).

    Returns:
        determinants [µm³] (6 times the volume of a straight tet10, the volume of a straight
        wedge15), corners first, shape (n_cells, 5) or (n_cells, 7).
    """
    rows = np.einsum("qai,caj->icqj", _GRADIENTS[cells.shape[1]], points[cells])
    determinants: FloatArray = np.sum(rows[0] * np.cross(rows[1], rows[2]), axis=-1)
    return determinants


def inverted_cells(points: FloatArray, cells: IntArray) -> IntArray:
    """Find the cells with a Jacobian that is not positive (NaN included), shape (n,)."""
    return np.flatnonzero(~(jacobians(points, cells) > 0).all(axis=1))


# Corners of the faces of a cell, those of a quadrilateral in order round it.
_FACES = {
    10: ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)),
    15: ((0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)),
}


def outer_triangles(cells: IntArray) -> IntArray:
    """Corners of the outer faces of a mesh, quadrilaterals halved, in no order, shape (n, 3)."""
    triangles = []
    by_size: dict[int, list[tuple[int, ...]]] = {3: [], 4: []}
    for face in _FACES[cells.shape[1]]:
        by_size[len(face)].append(face)
    for size, table in by_size.items():
        if not table:
            continue
        faces = cells[:, np.array(table)].reshape(-1, size)
        _, first, count = np.unique(
            np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True
        )
        outer = faces[first[count == 1]]
        triangles.append(outer[:, :3])
        if size == 4:
            triangles.append(outer[:, [0, 2, 3]])
    return np.concatenate(triangles)
