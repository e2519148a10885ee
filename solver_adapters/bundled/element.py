"""The quadratic elements: shape functions, their gradients and weights at the Gauss points.

An element is known by its number of nodes: the ten-node tetrahedron with 4 points and the
serendipity wedge of fifteen nodes with 6 (3 of the triangle × 2 of the line), nodes in VTK order.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Corners joined by the edges that carry the further nodes (VTK order).
TET_EDGES = ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))


@dataclass(frozen=True, eq=False)
class Element:
    """A reference cell and its quadrature.

    Attributes:
        name: its name in messages.
        positions: Gauss points in reference coordinates, (n_gauss, 3).
        weights: reference weights, their sum the reference volume, (n_gauss,).
        values: shape functions at the Gauss points, (n_gauss, n_nodes).
        gradients: reference gradients of the shape functions there, (n_gauss, n_nodes, 3).
    """

    name: str
    positions: FloatArray
    weights: FloatArray
    values: FloatArray
    gradients: FloatArray


def tet10_shape(positions: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Shape functions (n, 10) and gradients (n, 10, 3) at reference positions (n, 3)."""
    barycentric = np.column_stack([1 - positions.sum(axis=1), positions])
    corner = np.array([[-1.0, -1.0, -1.0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    first, second = np.array(TET_EDGES).T
    a, b = barycentric[:, first], barycentric[:, second]
    values = np.concatenate([barycentric * (2 * barycentric - 1), 4 * a * b], axis=1)
    at_corners = (4 * barycentric - 1)[:, :, None] * corner
    at_edges = 4 * (a[:, :, None] * corner[second] + b[:, :, None] * corner[first])
    return values, np.concatenate([at_corners, at_edges], axis=1)


def wedge15_shape(positions: FloatArray) -> tuple[FloatArray, FloatArray]:
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


def _tet10() -> Element:
    """Four points of degree 2."""
    a, b = (5 + 3 * np.sqrt(5)) / 20, (5 - np.sqrt(5)) / 20
    positions = np.vstack([np.zeros(3), (a - b) * np.eye(3)]) + b
    return Element("tet10", positions, np.full(4, 1 / 24), *tet10_shape(positions))


def _wedge15() -> Element:
    """Three points of degree 2 in the triangle times two of degree 3 along the line.

    A third point along the line locks plastic flow. The load of a clamped plastic bar of
    2 × 4 × 2 bricks falls, when every brick is divided by eight, from 378.5 to 364.2 µN with nine
    points of a wedge, from 368.4 to 360.6 with six and, for tet10, from 375.4 to 364.6. The price
    are three motions of a lone wedge without strain at the six points; four wedges have none.
    """
    triangle = np.array([[1.0, 1.0], [4.0, 1.0], [1.0, 4.0]]) / 6
    line, line_weights = np.polynomial.legendre.leggauss(2)
    positions = np.column_stack([np.tile(triangle, (2, 1)), np.repeat(line, 3)])
    weights = np.repeat(line_weights, 3) / 6
    return Element("wedge15", positions, weights, *wedge15_shape(positions))


ELEMENTS: Mapping[int, Element] = MappingProxyType({10: _tet10(), 15: _wedge15()})
"""The elements by their number of nodes."""


def n_gauss(cells: IntArray) -> int:
    """Number of Gauss points of each cell, from the connectivity."""
    return len(ELEMENTS[cells.shape[1]].weights)


def gauss_positions(points: NDArray[Any], cells: IntArray) -> NDArray[Any]:
    """Positions of the Gauss points [µm], (n_cells, n_gauss, 3); points may be complex."""
    return np.asarray(np.einsum("qa,eai->eqi", ELEMENTS[cells.shape[1]].values, points[cells]))


def shape_gradients(points: FloatArray, cells: IntArray) -> tuple[FloatArray, FloatArray]:
    """Physical shape gradients [1/µm] and weights [µm³] at the Gauss points.

    Args:
        points: node coordinates [µm], (n_nodes, 3).
        cells: connectivity in VTK order, (n_cells, 10) or (n_cells, 15).

    Returns:
        gradients (n_cells, n_gauss, n, 3) and weights (n_cells, n_gauss).

    Raises:
        ValueError: a cell is inverted, or of a kind that has no element here.
    """
    element = ELEMENTS.get(cells.shape[1])
    if element is None:
        known = ", ".join(f"{e.name} ({n})" for n, e in ELEMENTS.items())
        raise ValueError(f"the cells have {cells.shape[1]} nodes; expected one of {known}")
    jacobian = np.einsum("eai,qaj->eqij", points[cells], element.gradients)
    determinant = np.linalg.det(jacobian)
    if determinant.min() <= 0:
        cell = int(np.argmin(determinant.min(axis=1)))
        raise ValueError(f"cell {cell} of the mesh is inverted (Jacobian ≤ 0)")
    gradients = np.einsum("qaj,eqji->eqai", element.gradients, np.linalg.inv(jacobian))
    return np.ascontiguousarray(gradients), determinant * element.weights


def shape_gradient_velocity(
    gradients: FloatArray, weights: FloatArray, cells: IntArray, velocity: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Derivatives of `shape_gradients` when the nodes move with `velocity` (n_nodes, 3)."""
    spread = np.einsum("eai,eqaj->eqij", velocity[cells], gradients)
    return (
        -np.einsum("eqai,eqij->eqaj", gradients, spread),
        weights * np.trace(spread, axis1=2, axis2=3),
    )
