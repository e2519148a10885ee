"""The fifteen-node wedge in VTK order: Jacobians, and a triangle's grid swept into wedges."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

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

# The six corners and the centre, in reference coordinates (ζ from −1 to 1).
_CHECKED = np.concatenate([_CORNERS - [0, 0, 1], [[2 / 3, 2 / 3, 0]]]) / [2.0, 2.0, 1.0]


def _shape_gradients() -> FloatArray:
    """Reference gradients of the fifteen shape functions, shape (n_checked, 15, 3)."""
    powers = [(i, j, k) for k in range(3) for i in range(3) for j in range(3 - i)]
    # P2 in the triangle times P1 along the sweep, and the corners' P1 times ζ².
    powers = [p for p in powers if p[2] < 2 or p[0] + p[1] < 2]
    exponents = np.array(powers)
    nodes = (_NODES - [0, 0, 1]) / [2.0, 2.0, 1.0]
    coefficients = np.linalg.inv(np.prod(nodes[:, None] ** exponents, axis=2))
    gradients = np.empty((len(_CHECKED), 15, 3))
    for axis in range(3):
        lowered = np.maximum(exponents - np.eye(3, dtype=np.int64)[axis], 0)
        monomials = exponents[:, axis] * np.prod(_CHECKED[:, None] ** lowered, axis=2)
        gradients[:, :, axis] = monomials @ coefficients
    return gradients


_GRADIENTS = _shape_gradients()


def jacobians(points: FloatArray, cells: IntArray) -> FloatArray:
    """Jacobian determinant of the quadratic map of each cell at its corners and its centre.

    Args:
        points: node coordinates [µm], shape (n_nodes, 3).
        cells: wedge15 connectivity in VTK order, shape (n_cells, 15).

    Returns:
        determinants [µm³] (the volume of a straight cell), shape (n_cells, 7).
    """
    rows = np.einsum("qai,caj->icqj", _GRADIENTS, points[cells])
    determinants: FloatArray = np.sum(rows[0] * np.cross(rows[1], rows[2]), axis=-1)
    return determinants


def swept(divisions: int, layers: int) -> tuple[IntArray, IntArray, dict[str, IntArray]]:
    """The grid of a triangle, swept.

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
