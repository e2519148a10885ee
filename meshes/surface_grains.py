"""Grains on the measured face of a mesh, and the lines between them."""

from __future__ import annotations

import numpy as np

from meshes.arrays import FloatArray, IntArray
from meshes.cells import outer_faces
from meshes.plane_cells import CellKind
from meshes.plane_mesh import PlaneMesh
from meshes.prism_mesh import PrismMesh

_INSET = 1e-6  # of the face, by which places beside it are drawn onto it
_STRAIGHT = 1e-9  # sine of the angle between two parts of one line


def segments_between_grains(mesh: PrismMesh) -> FloatArray:
    """Return the ends (X, Y) of lines between grains on the face [µm], shape (n, 2, 2).

    Edges of cells that go on straight between the same two grains are one line.

    Args:
        mesh: of straight cells.
    """
    corners, grain = _faces(mesh)
    n = corners.shape[1]
    edges = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2)
    of_edges = np.repeat(grain, n)
    lines, which = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True)
    low = np.full(len(lines), mesh.n_grains)
    high = np.full(len(lines), -1)
    np.minimum.at(low, which.ravel(), of_edges)
    np.maximum.at(high, which.ravel(), of_edges)
    between = low < high
    segments: list[list[int]] = []
    for pair in np.unique(np.column_stack([low, high])[between], axis=0):
        own = between & (low == pair[0]) & (high == pair[1])
        segments += _joined(mesh.points, lines[own])
    return mesh.points[np.reshape(np.array(segments, dtype=np.int64), (-1, 2)), :2]


def middles_of_grains(mesh: PrismMesh) -> list[tuple[int, FloatArray]]:
    """Grains that reach the face, from 0, with the middle X, Y [µm] of the face nearest to theirs.

    Args:
        mesh: of straight cells.
    """
    corners, grain = _faces(mesh)
    middles = mesh.points[corners, :2].mean(axis=1)
    found = []
    for k in np.unique(grain):
        own = middles[grain == k]
        nearest = np.argmin(np.linalg.norm(own - own.mean(axis=0), axis=1))
        found.append((int(k), own[nearest]))
    return found


def grains_at(mesh: PrismMesh, xy: FloatArray) -> IntArray:
    """Return the grain on the measured face at each place, or beside it at the nearest of its rim.

    Args:
        mesh: of straight cells.
        xy: places X, Y [µm], shape (n, 2).

    Returns:
        its index, from 0, shape (n,).
    """
    corners, grain = _faces(mesh)
    nodes, local = np.unique(corners, return_inverse=True)
    points = mesh.points[nodes, :2]
    kind: CellKind = "tri3" if corners.shape[1] == 3 else "quad4"
    face = PlaneMesh(points, local.reshape(corners.shape), kind)
    low, high = points.min(axis=0), points.max(axis=0)
    inset = _INSET * (high - low)
    found: IntArray = grain[face.locate(np.clip(xy, low + inset, high - inset))[0]]
    return found


def _faces(mesh: PrismMesh) -> tuple[IntArray, IntArray]:
    """Corners of the faces of TOP, shape (n, 3 or 4), and their grains, shape (n,)."""
    outer, cell = outer_faces(mesh.cells)
    top = np.isin(outer, mesh.nodes["TOP"]).all(axis=1)
    return outer[top, : outer.shape[1] // 2], mesh.grain[cell[top]]


def _joined(points: FloatArray, lines: IntArray) -> list[list[int]]:
    """Join lines that go on straight: end nodes of each."""
    left = [list(line) for line in lines.tolist()]
    joined: list[list[int]] = []
    while left:
        line, grown = left.pop(), True
        while grown:
            grown = False
            for other in left:
                if (ends := _one_line(points, line, other)) is not None:
                    left.remove(other)
                    line, grown = ends, True
                    break
        joined.append(line)
    return joined


def _one_line(points: FloatArray, line: list[int], other: list[int]) -> list[int] | None:
    shared = set(line) & set(other)
    if len(shared) != 1:
        return None
    (middle,) = shared
    (start,), (end,) = set(line) - shared, set(other) - shared
    a, b = points[middle, :2] - points[start, :2], points[end, :2] - points[middle, :2]
    lengths = float(np.linalg.norm(a) * np.linalg.norm(b))
    straight = abs(a[0] * b[1] - a[1] * b[0]) <= _STRAIGHT * lengths and float(a @ b) > 0
    return [start, end] if straight else None
