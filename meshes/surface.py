"""The measured face as a plane tri6 mesh, and its interpolation to image points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from meshes.prism_mesh import PrismMesh

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_TOLERANCE = 1e-9


@dataclass(frozen=True, eq=False)
class SurfaceMesh:
    """The trace of a `PrismMesh` on one of its faces, seen along Z.

    Attributes:
        points: X and Y of the nodes [µm], shape (n_nodes, 2).
        cells: tri6 connectivity (3 corners, then the mid-edge nodes of 01, 12, 20), straight
            sides, shape (n_cells, 6).
        nodes: index of each node in `PrismMesh.points`, sorted, shape (n_nodes,).
    """

    points: FloatArray
    cells: IntArray
    nodes: IntArray


def trace(mesh: PrismMesh, group: str = "TOP") -> SurfaceMesh:
    """The mesh of a face that is not seen edge-on along Z.

    Args:
        mesh: the prism.
        group: name of the face.

    Raises:
        ValueError: the face is made of quad8, as TOP is in a mesh of wedges.
    """
    if mesh.faces[group].shape[1] != 6:
        raise ValueError(
            f"the face {group} is made of quad8; a tri6 face, of a tet10 mesh, is expected"
        )
    nodes, local = np.unique(mesh.faces[group], return_inverse=True)
    return SurfaceMesh(mesh.points[nodes, :2], local.reshape(-1, 6), nodes)


def interpolation(surface: SurfaceMesh, xy: FloatArray) -> tuple[sp.csr_array, BoolArray]:
    """Values at given points as linear combinations of nodal values (quadratic shape functions).

    Args:
        surface: the mesh, straight-sided.
        xy: points [µm], shape (n_points, 2).

    Returns:
        matrix of shape (n_points, n_nodes), with an all-zero row for each point off the mesh;
        whether each point lies on the mesh (to 1e-9 of a cell), shape (n_points,).
    """
    cell, barycentric = _locate(surface, xy)
    inside = cell >= 0
    values = _tri6_shape(barycentric[inside])
    columns = surface.cells[cell[inside]]
    row_ends = np.concatenate([[0], np.cumsum(6 * inside)])
    matrix = sp.csr_array(
        (values.ravel(), columns.ravel(), row_ends), shape=(len(xy), len(surface.points))
    )
    return matrix, inside


def _tri6_shape(barycentric: FloatArray) -> FloatArray:
    """Shape functions at barycentric coordinates (n, 3), shape (n, 6)."""
    corners = barycentric * (2 * barycentric - 1)
    edges = 4 * barycentric * np.roll(barycentric, -1, axis=1)
    return np.concatenate([corners, edges], axis=1)


def _locate(surface: SurfaceMesh, xy: FloatArray) -> tuple[IntArray, FloatArray]:
    """Cell that holds each point (−1 for none) and barycentric coordinates there, (n,), (n, 3).

    The points are sorted along Y, so that each cell is tested against the few at its height.
    """
    order = np.argsort(xy[:, 1], kind="stable")
    x, y = xy[order].T
    corners = surface.points[surface.cells[:, :3]]
    margin = _TOLERANCE * np.ptp(corners[..., 1], axis=1)
    first = np.searchsorted(y, corners[..., 1].min(axis=1) - margin, side="left")
    last = np.searchsorted(y, corners[..., 1].max(axis=1) + margin, side="right")
    # (b, c) = inverse @ (point − corner 0), the coordinates of corners 1 and 2.
    inverse = np.linalg.inv(np.swapaxes(corners[:, 1:] - corners[:, :1], 1, 2))

    cell = np.full(len(xy), -1, dtype=np.int64)
    barycentric = np.zeros((len(xy), 3))
    for k, (i, j) in enumerate(zip(first, last, strict=True)):
        dx, dy = x[i:j] - corners[k, 0, 0], y[i:j] - corners[k, 0, 1]
        b = inverse[k, 0, 0] * dx + inverse[k, 0, 1] * dy
        c = inverse[k, 1, 0] * dx + inverse[k, 1, 1] * dy
        a = 1 - b - c
        found = np.flatnonzero(np.minimum(np.minimum(a, b), c) >= -_TOLERANCE)
        cell[order[i + found]] = k
        barycentric[order[i + found]] = np.column_stack([a[found], b[found], c[found]])
    return cell, barycentric
