"""The fifteen-node wedge in VTK order: shape functions, and a triangle's grid swept into wedges."""

from __future__ import annotations

import numpy as np

from meshes.arrays import FloatArray, IntArray

EDGES = np.array([[0, 1], [1, 2], [2, 0], [3, 4], [4, 5], [5, 3], [0, 3], [1, 4], [2, 5]])
"""Corners joined by the edges that carry local nodes 6 to 14 (VTK order)."""

MIRRORED = np.array([0, 2, 1, 3, 5, 4, 8, 7, 6, 11, 10, 9, 12, 14, 13])
"""Local order of the same wedge15 seen with the other handedness."""

# Corners in the grid of half cells (two directions in the triangle, one along the sweep).
_CORNERS = np.array([[0, 0, 0], [2, 0, 0], [0, 2, 0], [0, 0, 2], [2, 0, 2], [0, 2, 2]])
_NODES = np.concatenate([_CORNERS, _CORNERS[EDGES].sum(axis=1) // 2])
# The triangle that completes the parallelogram of the one above.
_TURNED = np.array([2, 2, 0]) + _NODES * [-1, -1, 1]
# Outer faces of the sweep, as corners and their mid-edge nodes, outward normal.
_BOTTOM, _TOP = [0, 2, 1, 8, 7, 6], [3, 4, 5, 9, 10, 11]
_SIDE = [0, 1, 4, 3, 6, 13, 9, 12]

CHECKED = np.concatenate([_CORNERS - [0, 0, 1], [[2 / 3, 2 / 3, 0]]]) / [2.0, 2.0, 1.0]
"""The six corners and the centre, in reference coordinates (ζ from −1 to 1)."""


def shape_functions(positions: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Shape functions (n, 15) and gradients (n, 15, 3) at reference positions (n, 3).

    The first two coordinates span the triangle, the third, ζ, runs from −1 at the corners 0 1 2
    to 1 at 3 4 5. With the barycentric L of the triangle: at a corner L(2L − 1)(1 ± ζ)/2 −
    L(1 − ζ²)/2, on an edge of a triangle 2 L L'(1 ± ζ), on an edge along ζ L(1 − ζ²)
    (Zienkiewicz and Taylor, The Finite Element Method, vol. 1).
    """
    z = positions[:, 2, None]
    L = np.column_stack([1 - positions[:, 0] - positions[:, 1], positions[:, :2]])
    dL = np.array([[-1.0, -1.0], [1, 0], [0, 1]])
    N, M = L, np.roll(L, -1, axis=1)  # edges 01, 12, 20
    dN, dM = dL, np.roll(dL, -1, axis=0)
    bubble = 1 - z**2
    corner = [L * (2 * L - 1) * (1 + s * z) / 2 - L * bubble / 2 for s in (-1, 1)]
    edge = [2 * N * M * (1 + s * z) for s in (-1, 1)]
    values = np.concatenate([*corner, *edge, L * bubble], axis=1)
    across, along = [], []
    for s in (-1, 1):
        across.append(((4 * L - 1) * (1 + s * z) / 2 - bubble / 2)[:, :, None] * dL)
        along.append(s * L * (2 * L - 1) / 2 + L * z)
    for s in (-1, 1):
        across.append(2 * (1 + s * z)[:, :, None] * (N[:, :, None] * dM + M[:, :, None] * dN))
        along.append(2 * s * N * M)
    across.append(bubble[:, :, None] * dL)
    along.append(-2 * L * z)
    gradients = np.empty((len(positions), 15, 3))
    gradients[:, :, :2] = np.concatenate(across, axis=1)
    gradients[:, :, 2] = np.concatenate(along, axis=1)
    return values, gradients


def swept(divisions: int, layers: int) -> tuple[IntArray, IntArray, dict[str, IntArray]]:
    """Return the grid of a triangle, swept.

    Args:
        divisions: cells along each side of the triangle.
        layers: cells along the sweep.

    Returns:
        grid place of each node in half cells (two directions in the triangle, one along the
        sweep), shape (n_nodes, 3); cells, shape (n_cells, 15), layer by layer; and the faces
        S_MINUS and S_PLUS as tri6 (n, 6), TOP as quad8 (n, 8): the side where the second
        direction is zero.
    """
    span = np.arange(divisions)
    k, j, i = np.meshgrid(np.arange(layers), span, span, indexing="ij")
    bases = 2 * np.stack([i, j, k], axis=-1).reshape(-1, 3)
    room = 2 * divisions - bases[:, 0] - bases[:, 1]
    upright, turned = bases[room > 0], bases[room > 2]
    places = np.concatenate([upright[:, None] + _NODES, turned[:, None] + _TURNED])
    places = places[np.argsort(places[:, 0, 2], kind="stable")]
    grid, inverse = np.unique(places.reshape(-1, 3), axis=0, return_inverse=True)
    cells = inverse.reshape(-1, 15)
    on_top = (places[:, :2, 1] == 0).all(axis=1)
    faces = {
        "S_PLUS": cells[places[:, 3, 2] == 2 * layers][:, _TOP],
        "S_MINUS": cells[places[:, 0, 2] == 0][:, _BOTTOM],
        "TOP": cells[on_top][:, _SIDE],
    }
    return grid, cells, faces
