"""Small plane meshes over the square 0 ≤ X, Y ≤ 3."""

from __future__ import annotations

import numpy as np

from meshes.plane_cells import CELLS, CellKind
from meshes.plane_mesh import PlaneMesh


def distorted(kind: CellKind, by: float = 0.2, n: int = 3, scale: float = 1.0) -> PlaneMesh:
    """n × n squares, halved for triangles, inner corners moved by `by`, sides straight."""
    i = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    quads = np.stack([i[:-1, :-1], i[1:, :-1], i[1:, 1:], i[:-1, 1:]], axis=-1).reshape(-1, 4)
    x, y = np.meshgrid(np.linspace(0, 3, n + 1), np.linspace(0, 3, n + 1), indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel()])
    inner = ((points > 0) & (points < 3)).all(axis=1)
    points[inner] += np.random.default_rng(3).uniform(-by, by, (inner.sum(), 2)) * 3 / n
    corners = CELLS[kind].n_corners
    cells = quads if corners == 4 else np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    if CELLS[kind].n_nodes > corners:
        sides = np.stack([cells, np.roll(cells, -1, axis=1)], axis=-1)
        ends, which = np.unique(np.sort(sides.reshape(-1, 2), axis=1), axis=0, return_inverse=True)
        middle = len(points) + which.reshape(len(cells), corners)
        points = np.vstack([points, points[ends].mean(axis=1)])
        cells = np.hstack([cells, middle])
    return PlaneMesh(points * scale, cells, kind)
