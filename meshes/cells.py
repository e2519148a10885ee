"""What tet10 and hex20 cells have in common, by their number of nodes."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from meshes import hex20, tet10
from meshes.arrays import FloatArray, IntArray

NAMES: Mapping[int, str] = MappingProxyType({10: "tet10", 20: "hex20"})
"""What a kind of cells is called."""

EDGES: Mapping[int, IntArray] = MappingProxyType({10: tet10.EDGES, 20: hex20.EDGES})
"""Corners joined by the edges that carry the nodes after the corners."""

FACES: Mapping[int, IntArray] = MappingProxyType({10: tet10.FACES, 20: hex20.FACES})
"""Faces of a cell, outward normal: corners in order round it, then as many mid-edge nodes."""

# Reference gradients of the shape functions at the corners and the centre.
_GRADIENTS = {
    10: tet10.shape_functions(tet10.CHECKED)[1],
    20: hex20.shape_functions(hex20.CHECKED)[1],
}


def _quadrature() -> dict[int, tuple[tuple[FloatArray, FloatArray], FloatArray]]:
    """Shape functions, their gradients and weights at points exact for a quadratic in a cell."""
    far, near = 0.25 + 0.15 * np.sqrt(5.0), 0.25 - 0.05 * np.sqrt(5.0)
    tetrahedral = np.full((4, 3), near)
    tetrahedral[np.arange(1, 4), np.arange(3)] = far
    at, weight = np.polynomial.legendre.leggauss(3)
    hexahedral = np.stack(np.meshgrid(at, at, at, indexing="ij"), axis=-1).reshape(-1, 3)
    return {
        10: (tet10.shape_functions(tetrahedral), np.full(4, 1.0 / 24.0)),
        20: (
            hex20.shape_functions(hexahedral),
            np.einsum("i,j,k->ijk", weight, weight, weight).ravel(),
        ),
    }


_QUADRATURE = _quadrature()


def jacobians(points: FloatArray, cells: IntArray) -> FloatArray:
    """Jacobian determinant of the quadratic map of each cell at its corners and its centre.

    Args:
        points: node coordinates [µm], shape (n_nodes, 3).
        cells: connectivity in VTK order, shape (n_cells, 10) or (n_cells, 20).

    Returns:
        determinants [µm³] (6 times the volume of a straight tet10, an eighth of that of a hex20
        with parallel faces), corners first, shape (n_cells, 5) or (n_cells, 9).
    """
    rows = np.einsum("qai,caj->icqj", _GRADIENTS[cells.shape[1]], points[cells])
    determinants: FloatArray = np.sum(rows[0] * np.cross(rows[1], rows[2]), axis=-1)
    return determinants


def extent_along_y(points: FloatArray, cells: IntArray) -> tuple[float, float]:
    """Return the mean of Y over the volume of cells and √3 of its standard deviations [µm].

    Of a uniform bar that is half of its length.

    Args:
        points: node coordinates [µm], shape (n_nodes, 3).
        cells: connectivity in VTK order, shape (n_cells, 10) or (n_cells, 20).
    """
    (values, gradients), weights = _QUADRATURE[cells.shape[1]]
    jacobian = np.linalg.det(np.einsum("cai,qaj->cqij", points[cells], gradients))
    volume = (jacobian * weights).ravel()
    y = (points[cells, 1] @ values.T).ravel()
    mean = float(volume @ y / volume.sum())
    return mean, float(np.sqrt(3.0 * (volume @ (y - mean) ** 2) / volume.sum()))


def inverted_cells(points: FloatArray, cells: IntArray) -> IntArray:
    """Find the cells with a Jacobian that is not positive (NaN included), shape (n,)."""
    return np.flatnonzero(~(jacobians(points, cells) > 0).all(axis=1))


def outer_faces(cells: IntArray) -> tuple[IntArray, IntArray]:
    """Faces that belong to one cell only, with outward normal, in the order of the cells.

    Args:
        cells: connectivity in VTK order, shape (n_cells, 10) or (n_cells, 20).

    Returns:
        faces, tri6 of shape (n, 6) or quad8 of shape (n, 8); the cell of each, shape (n,).
    """
    table = FACES[cells.shape[1]]
    faces = cells[:, table].reshape(-1, table.shape[1])
    outer = np.sort(_single(faces[:, : table.shape[1] // 2]))
    return faces[outer], outer // len(table)


def outer_triangles(cells: IntArray) -> IntArray:
    """Corners of the outer faces of a mesh, quadrilaterals halved, in no order, shape (n, 3)."""
    table = FACES[cells.shape[1]]
    size = table.shape[1] // 2
    faces = cells[:, table[:, :size]].reshape(-1, size)
    outer = faces[_single(faces)]
    if size == 3:
        return outer
    return np.concatenate([outer[:, :3], outer[:, [0, 2, 3]]])


def _single(faces: IntArray) -> IntArray:
    """Rows of the faces (corners, in any order) that occur once, ordered by their nodes, (n,)."""
    _, first, count = np.unique(
        np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True
    )
    return np.asarray(first[count == 1])
