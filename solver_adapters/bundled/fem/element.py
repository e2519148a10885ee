"""The quadratic elements: Gauss points, and what is known there of the shape functions.

By its number of nodes a cell is one of two elements, nodes in VTK order: the ten-node tetrahedron
with 4 points, or 5 where they are asked for, and the serendipity hexahedron of twenty nodes with 8
(2 × 2 × 2).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshes import hex20, tet10
from meshes.arrays import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Element:
    """A reference cell and its quadrature.

    Attributes:
        name: its name in messages.
        weights: reference weights, their sum the reference volume, (n_gauss,).
        values: shape functions at the Gauss points, (n_gauss, n_nodes).
        gradients: reference gradients of the shape functions there, (n_gauss, n_nodes, 3).
        dilatation: functions that a projected dilatation follows, at the Gauss points,
            (n_gauss, n_functions), see `dilatation`.
    """

    name: str
    weights: FloatArray
    values: FloatArray
    gradients: FloatArray
    dilatation: FloatArray


def _tet10() -> Element:
    """Four points of degree 2."""
    a, b = (5 + 3 * np.sqrt(5)) / 20, (5 - np.sqrt(5)) / 20
    positions = np.vstack([np.zeros(3), (a - b) * np.eye(3)]) + b
    return Element("tet10", np.full(4, 1 / 24), *tet10.shape_functions(positions), np.ones((4, 1)))


def _tet10_five() -> Element:
    """Five points of degree 3, the centre with a negative weight: Code_Aster's rule FPG5."""
    corners = np.full((4, 3), 1 / 6) + np.vstack([np.zeros(3), np.eye(3) / 3])
    positions = np.vstack([np.full(3, 0.25), corners])
    weights = np.array([-2 / 15, 3 / 40, 3 / 40, 3 / 40, 3 / 40])
    return Element("tet10", weights, *tet10.shape_functions(positions), np.ones((5, 1)))


def _hex20() -> Element:
    """Two points of degree 3 along each of the three axes.

    Three along each lock plastic flow (figures in benchmarks/numerics.md). The price of two are
    six motions of a lone hexahedron without strain at the eight points. Neighbours do not share
    them, save in a straight column one brick wide: it keeps one at each face between bricks even
    where both ends are held. A prism has three cells or more side by side, and keeps none.
    """
    line, _ = np.polynomial.legendre.leggauss(2)
    positions = np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1).reshape(-1, 3)
    linear = np.column_stack([np.ones(8), positions])
    return Element("hex20", np.ones(8), *hex20.shape_functions(positions), linear)


ELEMENTS: Mapping[int, Element] = MappingProxyType({10: _tet10(), 20: _hex20()})
"""The elements by their number of nodes, with their own quadrature."""
TET10_FIVE = _tet10_five()
"""The tetrahedron with the other quadrature."""


def element_of(cells: IntArray, tet10_points: int | None = None) -> Element:
    """Return the element of cells (n_cells, n) in VTK order.

    Args:
        cells: connectivity.
        tet10_points: Gauss points of a tetrahedron of ten nodes, None for its own four.

    Raises:
        ValueError: there is none of their number of nodes.
    """
    element = ELEMENTS.get(cells.shape[1])
    if element is None:
        known = ", ".join(f"{e.name} ({n})" for n, e in ELEMENTS.items())
        raise ValueError(f"the cells have {cells.shape[1]} nodes; expected one of {known}")
    return TET10_FIVE if tet10_points == 5 and element is ELEMENTS[10] else element


def gauss_positions(points: NDArray[Any], cells: IntArray, element: Element) -> NDArray[Any]:
    """Positions of the Gauss points [µm], (n_cells, n_gauss, 3); points may be complex."""
    return np.asarray(element.values @ points[cells])


def shape_gradients(
    points: FloatArray, cells: IntArray, element: Element
) -> tuple[FloatArray, FloatArray]:
    """Physical shape gradients [1/µm] and weights [µm³] at the Gauss points.

    Args:
        points: node coordinates [µm], (n_nodes, 3).
        cells: connectivity in VTK order, (n_cells, n).
        element: what the cells are, see `element_of`.

    Returns:
        gradients (n_cells, n_gauss, n, 3) and weights (n_cells, n_gauss).

    Raises:
        ValueError: a cell is inverted.
    """
    jacobian = np.swapaxes(points[cells], 1, 2)[:, None] @ element.gradients
    determinant = np.linalg.det(jacobian)
    if determinant.min() <= 0:
        cell = int(np.argmin(determinant.min(axis=1)))
        raise ValueError(f"cell {cell} of the mesh is inverted (Jacobian ≤ 0)")
    gradients = element.gradients @ np.linalg.inv(jacobian)
    return np.ascontiguousarray(gradients), determinant * element.weights


def shape_gradient_velocity(
    gradients: FloatArray, weights: FloatArray, cells: IntArray, velocity: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return derivatives of `shape_gradients` when the nodes move with `velocity` (n_nodes, 3)."""
    spread = np.swapaxes(velocity[cells], 1, 2)[:, None] @ gradients
    return (
        -(gradients @ spread),
        weights * np.trace(spread, axis1=2, axis2=3),
    )
