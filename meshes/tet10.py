"""The ten-node tetrahedron in VTK order: shape functions, node groups of a prism."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from meshes.arrays import FloatArray, IntArray
from meshes.prism_mesh import FACE_GROUPS

EDGES = np.array([[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]])
"""Corners joined by the edges that carry local nodes 4 to 9 (VTK order)."""

MIRRORED = np.array([0, 2, 1, 3, 6, 5, 4, 7, 9, 8])
"""Local order of the same tet10 seen with the other handedness."""

FACES = np.array([[0, 2, 1, 6, 5, 4], [0, 1, 3, 4, 8, 7], [1, 2, 3, 5, 9, 8], [0, 3, 2, 7, 9, 6]])
"""Faces of the reference cell, outward normal, as 3 corners and the mid-edge nodes 01, 12, 20."""

CHECKED = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0.25, 0.25, 0.25]])
"""The four corners and the centre, in reference coordinates."""


def shape_functions(positions: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Shape functions (n, 10) and gradients (n, 10, 3) at reference positions (n, 3)."""
    barycentric = np.column_stack([1 - positions.sum(axis=1), positions])
    corner = np.array([[-1.0, -1.0, -1.0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    first, second = EDGES.T
    a, b = barycentric[:, first], barycentric[:, second]
    values = np.concatenate([barycentric * (2 * barycentric - 1), 4 * a * b], axis=1)
    at_corners = (4 * barycentric - 1)[:, :, None] * corner
    at_edges = 4 * (a[:, :, None] * corner[second] + b[:, :, None] * corner[first])
    return values, np.concatenate([at_corners, at_edges], axis=1)


def centre_gradients(points: FloatArray, cells: IntArray) -> FloatArray:
    """Gradients of the shape functions at the centre of each cell.

    In a cell with straight edges a gradient at the centre is its mean over the cell.

    Args:
        points: node coordinates [µm], shape (n_nodes, 3).
        cells: tet10 connectivity in VTK order, shape (n_cells, 10).

    Returns:
        derivatives along X, Y, Z [1/µm], shape (n_cells, 10, 3).
    """
    centre = shape_functions(CHECKED[-1:])[1][0]
    map_gradient = np.einsum("cai,aj->cij", points[cells], centre)
    gradients: FloatArray = centre @ np.linalg.inv(map_gradient)
    return gradients


def node_groups(points: FloatArray, faces: Mapping[str, IntArray]) -> dict[str, IntArray]:
    """Nodes of the three faces, of the two measured edges and of the two apexes.

    L± is where S± meets TOP; P± is the lowest node (Z) of S±.

    Args:
        points: node coordinates [µm], shape (n_nodes, 3).
        faces: faces of S_PLUS, S_MINUS and TOP, tri6 (n, 6) or quad8 (n, 8).

    Returns:
        sorted node indices of every group of `PrismMesh`.
    """
    nodes = {name: np.unique(faces[name]) for name in FACE_GROUPS}
    for sign in ("PLUS", "MINUS"):
        end = nodes[f"S_{sign}"]
        nodes[f"L_{sign}"] = np.intersect1d(end, nodes["TOP"])
        nodes[f"P_{sign}"] = end[[np.argmin(points[end, 2])]]
    return nodes
