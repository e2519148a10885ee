"""Meshes of straight quadratic cells, made of corners alone, and each of their edges in pieces.

A mesh in pieces is nested in the one that it is made of: hexahedra by a grid of each, tetrahedra by
the edgewise subdivision of Edelsbrunner and Grayson (Discrete & Computational Geometry 24, 2000),
whose tetrahedra have few shapes, of which none is worse with more pieces.
"""

from __future__ import annotations

from itertools import permutations

import numpy as np

from meshes.arrays import FloatArray, IntArray
from meshes.cells import EDGES, jacobians, outer_faces
from meshes.hex20 import MIRRORED as MIRRORED_HEXAHEDRON
from meshes.prism_mesh import PrismMesh
from meshes.tet10 import node_groups

_ON_PLANE = 1e-8  # of the length, by which a node is off its plane
_NODES = {4: 10, 8: 20}  # of a quadratic cell, by its corners
_UNIT_CUBE = np.array(
    [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]
)


def straight_mesh(points: FloatArray, corners: IntArray, grain: IntArray) -> PrismMesh:
    """Return the mesh of cells with these corners, a node in the middle of every edge.

    The faces are those of the specimen frame: S_MINUS at Y = 0, S_PLUS at the largest Y, TOP at
    Z = 0. Left-handed cells are mirrored.

    Args:
        points: coordinates of the corners [µm], shape (n, 3); those of no cell are dropped.
        corners: of each cell, 4 or 8, shape (n_cells, 4 or 8).
        grain: of each cell, from 0, shape (n_cells,).
    """
    used, local = np.unique(corners, return_inverse=True)
    corners, points = local.reshape(corners.shape), points[used].copy()
    length = points[:, 1].max()
    planes = {"S_PLUS": (1, length), "S_MINUS": (1, 0.0), "TOP": (2, 0.0)}
    for axis, value in planes.values():
        points[np.abs(points[:, axis] - value) < _ON_PLANE * length, axis] = value
    corners = _right_handed(points, corners)
    table = EDGES[_NODES[corners.shape[1]]]
    edges = np.sort(corners[:, table], axis=2).reshape(-1, 2)
    ends, middle = np.unique(edges, axis=0, return_inverse=True)
    middles = points[ends].mean(axis=1)
    cells = np.concatenate([corners, len(points) + middle.reshape(-1, len(table))], axis=1)
    points = np.concatenate([points, middles])
    outer, _ = outer_faces(cells)
    faces = {
        name: outer[(points[outer][:, :, axis] == value).all(axis=1)]
        for name, (axis, value) in planes.items()
    }
    return PrismMesh(points, cells, grain, faces, node_groups(points, faces))


def in_pieces(mesh: PrismMesh, pieces: int) -> PrismMesh:
    """Return the mesh with every edge in so many pieces, and every cell in its third power.

    Args:
        mesh: of straight cells.
        pieces: 1 or more.
    """
    if pieces == 1:
        return mesh
    corners = mesh.cells[:, : 4 if mesh.cells.shape[1] == 10 else 8]
    if corners.shape[1] == 4:
        # Neighbours part a common face alike, for both count its corners in one order.
        corners = np.sort(corners, axis=1)
        places, cells = _simplex(pieces)
        weights = places @ np.array([[-1, 1, 0, 0], [0, -1, 1, 0], [0, 0, -1, 1]])
        weights[:, 0] += pieces
    else:
        places, cells = _cube(pieces)
        sides = np.stack([pieces - places, places])
        weights = np.prod([sides[_UNIT_CUBE[:, axis], :, axis] for axis in range(3)], axis=0).T
    points, nodes = _lattice(mesh.points, corners, weights)
    return straight_mesh(
        points, nodes[:, cells].reshape(-1, cells.shape[1]), np.repeat(mesh.grain, len(cells))
    )


def _right_handed(points: FloatArray, corners: IntArray) -> IntArray:
    """Return cells with the corners of left-handed ones in the mirrored order."""
    n_corners = corners.shape[1]
    mirrored = np.array([0, 2, 1, 3]) if n_corners == 4 else MIRRORED_HEXAHEDRON[:8]
    table = EDGES[_NODES[n_corners]]
    middles = points[corners[:, table]].mean(axis=2)
    every = np.concatenate([points[corners], middles], axis=1)
    rows = np.arange(every.shape[0] * every.shape[1]).reshape(every.shape[:2])
    left = jacobians(every.reshape(-1, 3), rows)[:, -1] < 0
    corners = corners.copy()
    corners[left] = corners[left][:, mirrored]
    return corners


def _simplex(pieces: int) -> tuple[IntArray, IntArray]:
    """Lattice points k₁ ≥ k₂ ≥ k₃ of a tetrahedron, (n, 3), and the tetrahedra between, (m, 4)."""
    grid = np.indices((pieces + 1,) * 3).reshape(3, -1).T
    inside = (np.diff(grid, axis=1) <= 0).all(axis=1)
    row = np.full(len(grid), -1)
    row[inside] = np.arange(inside.sum())
    row = row.reshape((pieces + 1,) * 3)
    cells = []
    for k in np.indices((pieces,) * 3).reshape(3, -1).T:
        for order in permutations(range(3)):
            steps = np.cumsum([np.zeros(3, dtype=int), *np.eye(3, dtype=int)[list(order)]], axis=0)
            nodes = row[tuple((k + steps).T)]
            if (nodes >= 0).all():
                cells.append(nodes)
    return grid[inside], np.array(cells)


def _cube(pieces: int) -> tuple[IntArray, IntArray]:
    """Lattice points of a hexahedron, shape (n, 3), and the hexahedra between, shape (m, 8)."""
    grid = np.indices((pieces + 1,) * 3).reshape(3, -1).T
    starts = np.indices((pieces,) * 3).reshape(3, -1).T
    at = starts[:, None] + _UNIT_CUBE
    return grid, at @ np.array([(pieces + 1) ** 2, pieces + 1, 1])


def _lattice(
    points: FloatArray, corners: IntArray, weights: IntArray
) -> tuple[FloatArray, IntArray]:
    """Points of all cells by their weights in whole numbers, those at one place once.

    Args:
        points: of the corners, shape (n, 3).
        corners: of the cells, shape (m, c).
        weights: of the corners of a cell at each of its places, of one sum, shape (p, c).

    Returns:
        points, shape (n', 3); the one at each place of each cell, shape (m, p).
    """
    total = int(weights[0].sum())
    codes = np.where(weights > 0, (corners[:, None] + 1) * (total + 1) + weights, 0)
    codes = np.sort(codes.reshape(-1, weights.shape[1]), axis=1)
    unique, node = np.unique(codes, axis=0, return_inverse=True)
    share = unique % (total + 1) / total
    corner = np.maximum(unique // (total + 1) - 1, 0)
    places = np.einsum("nc,ncx->nx", share, points[corner])
    return places, node.reshape(len(corners), len(weights))
