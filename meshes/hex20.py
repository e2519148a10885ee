"""The twenty-node hexahedron in VTK order: shape functions, and sections swept into hexahedra."""

from __future__ import annotations

import numpy as np

from meshes.arrays import FloatArray, IntArray

EDGES = np.array(
    [[0, 1], [1, 2], [2, 3], [3, 0], [4, 5], [5, 6], [6, 7], [7, 4], [0, 4], [1, 5], [2, 6], [3, 7]]
)
"""Corners joined by the edges that carry local nodes 8 to 19 (VTK order)."""

MIRRORED = np.array([0, 3, 2, 1, 4, 7, 6, 5, 11, 10, 9, 8, 15, 14, 13, 12, 16, 19, 18, 17])
"""Local order of the same hex20 seen with the other handedness."""

FACES = np.array(
    [
        [0, 3, 2, 1, 11, 10, 9, 8],
        [4, 5, 6, 7, 12, 13, 14, 15],
        [0, 1, 5, 4, 8, 17, 12, 16],
        [1, 2, 6, 5, 9, 18, 13, 17],
        [2, 3, 7, 6, 10, 19, 14, 18],
        [3, 0, 4, 7, 11, 16, 15, 19],
    ]
)
"""Faces of the reference cell, outward normal: 4 corners, the mid-edge nodes 01, 12, 23, 30."""

_CORNERS = np.array(
    [[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1]]
    + [[-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]]
)
_NODES = np.concatenate([_CORNERS, _CORNERS[EDGES].sum(axis=1) // 2])

CHECKED = np.concatenate([_CORNERS, [[0, 0, 0]]]).astype(np.float64)
"""The eight corners and the centre, in reference coordinates (each from −1 to 1)."""


def shape_functions(positions: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Shape functions (n, 20) and gradients (n, 20, 3) at reference positions (n, 3).

    At a corner (±1, ±1, ±1) = a the function is (1 + a₁ξ)(1 + a₂η)(1 + a₃ζ)(a₁ξ + a₂η + a₃ζ − 2)/8,
    in the middle of an edge along ξ (1 − ξ²)(1 + a₂η)(1 + a₃ζ)/4 (Zienkiewicz and Taylor, The
    Finite Element Method, vol. 1).
    """
    x = positions[:, None]
    n = len(_CORNERS)
    factors = np.where(_NODES == 0, 1 - x**2, 1 + _NODES * x)
    slopes = np.where(_NODES == 0, -2 * x, _NODES)
    product = factors.prod(axis=2)
    changes = slopes * factors[:, :, [1, 2, 0]] * factors[:, :, [2, 0, 1]]
    far = (_CORNERS * x).sum(axis=2) - 2
    values = np.concatenate([product[:, :n] * far / 8, product[:, n:] / 4], axis=1)
    at_corners = (changes[:, :n] * far[:, :, None] + product[:, :n, None] * _CORNERS) / 8
    return values, np.concatenate([at_corners, changes[:, n:] / 4], axis=1)


Sweep = tuple[FloatArray, FloatArray, IntArray, dict[str, IntArray]]
"""What a section swept into hexahedra is.

Shares that each node has in the corners of the section, shape (n_nodes, 3 or 4); its place along
the sweep in layers, shape (n_nodes,); cells, shape (n_cells, 20), layer by layer; and the faces
S_MINUS, S_PLUS and TOP, between the first two corners, as quad8 (n, 8).
"""


def swept_triangle(divisions: int, layers: int) -> Sweep:
    """Return a triangle of three blocks of quadrilaterals, swept.

    A block lies at each corner of the triangle: from there to the middles of both sides and to
    the centroid, bilinear.

    Args:
        divisions: cells along each side of a block.
        layers: cells along the sweep.
    """
    span = np.arange(divisions)
    k, block, j, i = (
        index.ravel()
        for index in np.meshgrid(np.arange(layers), np.arange(3), span, span, indexing="ij")
    )
    halves = 2 * np.stack([i, j, k], axis=-1)[:, None] + _NODES + 1
    # Bilinear in whole numbers, so that nodes of two blocks are the same to the last digit.
    u, v, layer = np.moveaxis(halves, 2, 0)
    a, b = 2 * divisions - u, 2 * divisions - v
    shares = np.stack(
        [6 * a * b + 3 * (u * b + a * v) + 2 * u * v, u * (3 * b + 2 * v), v * (3 * a + 2 * u)],
        axis=2,
    )
    of_corner = (np.arange(3) - block[:, None, None]) % 3
    shares = np.take_along_axis(shares, of_corner, axis=2)
    return _joined(layer, shares, layers)


def swept_quadrilateral(across: int, down: int, layers: int) -> Sweep:
    """Return a quadrilateral in rows of quadrilaterals, bilinear, swept.

    Args:
        across: cells from the first corner to the second.
        down: cells from the second corner to the third.
        layers: cells along the sweep.
    """
    k, j, i = (
        index.ravel()
        for index in np.meshgrid(
            np.arange(layers), np.arange(down), np.arange(across), indexing="ij"
        )
    )
    u, v, layer = np.moveaxis(2 * np.stack([i, j, k], axis=-1)[:, None] + _NODES + 1, 2, 0)
    a, b = 2 * across - u, 2 * down - v
    return _joined(layer, np.stack([a * b, u * b, u * v, a * v], axis=2), layers)


def _joined(layer: IntArray, shares: IntArray, layers: int) -> Sweep:
    """Join nodes at the same place.

    Args:
        layer: place of each node of each cell along the sweep, in half layers, shape (m, 20).
        shares: its shares in the corners, of any sum, shape (m, 20, n).
        layers: cells along the sweep.
    """
    places = np.concatenate([layer[:, :, None], shares], axis=2).reshape(-1, 1 + shares.shape[2])
    grid, inverse = np.unique(places, axis=0, return_inverse=True)
    cells = inverse.reshape(-1, len(_NODES))
    sides = cells[:, FACES].reshape(-1, FACES.shape[1])
    level, below = grid[sides][:, :, 0], grid[sides][:, :, 3:]
    faces = {
        "S_PLUS": sides[(level == 2 * layers).all(axis=1)],
        "S_MINUS": sides[(level == 0).all(axis=1)],
        "TOP": sides[(below == 0).all(axis=(1, 2))],
    }
    return grid[:, 1:] / grid[0, 1:].sum(), grid[:, 0] / 2, cells, faces
