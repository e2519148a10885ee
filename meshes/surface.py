"""The measured face as a plane quadratic mesh, and its interpolation to image points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from meshes.arrays import BoolArray, FloatArray, IntArray
from meshes.plane_mesh import PlaneMesh
from meshes.prism_mesh import PrismMesh

_TOLERANCE = 1e-9


@dataclass(frozen=True, eq=False)
class SurfaceMesh:
    """The trace of a `PrismMesh` on one of its faces, seen along Z.

    Attributes:
        points: X and Y of the nodes [µm], shape (n_nodes, 2).
        cells: connectivity, straight sides: tri6, shape (n_cells, 6) (3 corners, then the
            mid-edge nodes of 01, 12, 20), or quad8, shape (n_cells, 8) (4 corners, then those of
            01, 12, 23, 30).
        nodes: index of each node in `PrismMesh.points`, sorted, shape (n_nodes,).
    """

    points: FloatArray
    cells: IntArray
    nodes: IntArray

    @property
    def plane(self) -> PlaneMesh:
        """The same as a plane mesh of tri6 or quad8."""
        return PlaneMesh(self.points, self.cells, "tri6" if self.cells.shape[1] == 6 else "quad8")


def trace(mesh: PrismMesh, group: str = "TOP") -> SurfaceMesh:
    """Return the mesh of a face that is not seen edge-on along Z.

    Args:
        mesh: the prism, whose face is of tri6 or, in a mesh of hex20 cells, of quad8.
        group: name of the face.
    """
    faces = mesh.faces[group]
    nodes, local = np.unique(faces, return_inverse=True)
    return SurfaceMesh(mesh.points[nodes, :2], local.reshape(faces.shape), nodes)


def interpolation(surface: SurfaceMesh, xy: FloatArray) -> tuple[sp.csr_array, BoolArray]:
    """Values at given points as linear combinations of nodal values (quadratic shape functions).

    Args:
        surface: the mesh, straight-sided.
        xy: points [µm], shape (n_points, 2).

    Returns:
        matrix of shape (n_points, n_nodes), with an all-zero row for each point off the mesh;
        whether each point lies on the mesh (to 1e-9 of a cell), shape (n_points,).
    """
    cell, at = _located(surface, xy)
    inside = cell >= 0
    values = surface.plane.cell.shape(at[inside])
    return _operator(surface, cell, inside, values), inside


def interpolation_with_slopes(
    surface: SurfaceMesh, xy: FloatArray
) -> tuple[sp.csr_array, sp.csr_array, sp.csr_array]:
    """Values and derivatives along X and Y [1/µm] at given points from nodal values.

    On a side between two cells the derivatives are those in one of them.

    Args:
        surface: the mesh, straight-sided.
        xy: points [µm], shape (n_points, 2).

    Returns:
        Matrices of shape (n_points, n_nodes), with an all-zero row for each point off the mesh.
    """
    cell, at = _located(surface, xy)
    inside, plane = cell >= 0, surface.plane
    values = plane.cell.shape(at[inside])
    along_x, along_y = plane.gradients(cell[inside], at[inside]).transpose(2, 0, 1)
    return (
        _operator(surface, cell, inside, values),
        _operator(surface, cell, inside, along_x),
        _operator(surface, cell, inside, along_y),
    )


def _operator(
    surface: SurfaceMesh, cell: IntArray, inside: BoolArray, weights: FloatArray
) -> sp.csr_array:
    """Matrix of the weights (n, nodes of a cell) of the points inside, each in its cell."""
    columns = surface.cells[cell[inside]]
    row_ends = np.concatenate([[0], np.cumsum(columns.shape[1] * inside)])
    return sp.csr_array(
        (weights.ravel(), columns.ravel(), row_ends), shape=(len(cell), len(surface.points))
    )


def _located(surface: SurfaceMesh, xy: FloatArray) -> tuple[IntArray, FloatArray]:
    """Cell that holds each point (−1 for none) and reference coordinates there, (n,), (n, 2)."""
    if surface.cells.shape[1] == 6:
        cell, barycentric = _locate(surface, xy)
        return cell, barycentric[:, 1:]
    return surface.plane.locate(xy)


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
        inside = np.flatnonzero(np.minimum(np.minimum(a, b), c) >= -_TOLERANCE)
        cell[order[i + inside]] = k
        barycentric[order[i + inside]] = np.column_stack([a[inside], b[inside], c[inside]])
    return cell, barycentric
