"""Shape functions of plane cells by their name: tri3, tri6, quad4, quad8."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from meshes.arrays import FloatArray

CellKind = Literal["tri3", "tri6", "quad4", "quad8"]

# Reference positions of the nodes, corners first, then the middles of the sides 01, 12, ….
_TRIANGLE = np.array([[0, 0], [1, 0], [0, 1], [0.5, 0], [0.5, 0.5], [0, 0.5]])
_SQUARE = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [0, -1], [1, 0], [0, 1], [-1, 0]], float)


@dataclass(frozen=True)
class PlaneCell:
    """One kind of cell.

    Attributes:
        kind: its name.
        n_nodes: nodes of a cell.
        n_corners: corners of a cell, the first of its nodes.
    """

    kind: CellKind
    n_nodes: int
    n_corners: int

    @property
    def nodes(self) -> FloatArray:
        """Reference positions of the nodes, shape (n_nodes, 2)."""
        return (_TRIANGLE if self.n_corners == 3 else _SQUARE)[: self.n_nodes]

    @property
    def centre(self) -> FloatArray:
        """Reference position of the centre, shape (2,)."""
        return np.full(2, 1 / 3) if self.n_corners == 3 else np.zeros(2)

    @property
    def quadrature(self) -> tuple[FloatArray, FloatArray]:
        """Points (n, 2) and weights (n,): exact for the stiffness of the straight cell."""
        if self.n_corners == 3:
            points = np.array([[1, 1], [4, 1], [1, 4]]) / 6
            return points, np.full(3, 1 / 6)
        line, weight = np.polynomial.legendre.leggauss(3)
        grid = np.stack(np.meshgrid(line, line, indexing="ij"), axis=-1).reshape(-1, 2)
        return grid, np.outer(weight, weight).ravel()

    def excess(self, at: FloatArray) -> FloatArray:
        """How far reference positions (n, 2) lie outside the cell, 0 on its border, (n,)."""
        if self.n_corners == 3:
            return np.asarray(np.max([-at[:, 0], -at[:, 1], at.sum(axis=1) - 1], axis=0))
        return np.asarray(np.abs(at).max(axis=1) - 1)

    def shape(self, at: FloatArray) -> FloatArray:
        """Shape functions at reference positions (n, 2), shape (n, n_nodes)."""
        if self.n_corners == 3:
            a = np.column_stack([1 - at.sum(axis=1), at])
            if self.n_nodes == 3:
                return a
            return np.hstack([a * (2 * a - 1), 4 * a * np.roll(a, -1, axis=1)])
        x, y = at.T[:, :, None]
        xi, eta = _SQUARE[:4].T
        corner = 0.25 * (1 + x * xi) * (1 + y * eta)
        if self.n_nodes == 4:
            return np.asarray(corner)
        middle = 0.5 * np.hstack(
            [(1 - x**2) * (1 - y), (1 + x) * (1 - y**2), (1 - x**2) * (1 + y), (1 - x) * (1 - y**2)]
        )
        return np.hstack([corner * (x * xi + y * eta - 1), middle])

    def gradient(self, at: FloatArray) -> FloatArray:
        """Return reference derivatives of the shape functions at (n, 2), shape (n, n_nodes, 2)."""
        # The functions are polynomials: a complex step is exact to rounding.
        columns = [self.shape(at + 1e-30j * axis).imag / 1e-30 for axis in np.eye(2)]
        return np.stack(columns, axis=-1)


CELLS: dict[CellKind, PlaneCell] = {
    "tri3": PlaneCell("tri3", 3, 3),
    "tri6": PlaneCell("tri6", 6, 3),
    "quad4": PlaneCell("quad4", 4, 4),
    "quad8": PlaneCell("quad8", 8, 4),
}
