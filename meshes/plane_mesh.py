"""A plane finite-element mesh, and where points lie in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from meshes.arrays import FloatArray, IntArray
from meshes.plane_cells import CELLS, CellKind, PlaneCell

TOLERANCE = 1e-9
"""How far outside a cell a point may lie to be counted in, in reference coordinates."""
NEWTON_STEPS = 30


@dataclass(frozen=True, eq=False)
class PlaneMesh:
    """Cells of one kind in the plane.

    Attributes:
        points: X, Y of the nodes [µm], shape (n_nodes, 2).
        cells: connectivity: corners counter-clockwise or clockwise, then the nodes on the sides
            01, 12, …; sides may be curved; shape (n_cells, nodes of the kind).
        kind: "tri3", "tri6", "quad4" or "quad8".
    """

    points: FloatArray
    cells: IntArray
    kind: CellKind

    def check(self) -> None:
        """Refuse a mesh in which points cannot be placed.

        Raises:
            ValueError: an unknown kind, arrays of another shape, a node of no cell, a folded cell.
        """
        if self.kind not in CELLS:
            raise ValueError(f"kind of cells {self.kind!r}; one of {', '.join(CELLS)} is expected.")
        cell = self.cell
        if self.points.ndim != 2 or self.points.shape[1] != 2 or not np.isfinite(self.points).all():
            raise ValueError(
                f"points of shape {self.points.shape}; finite X, Y of shape (n_nodes, 2) are "
                "expected."
            )
        if self.cells.ndim != 2 or self.cells.shape[1] != cell.n_nodes or not len(self.cells):
            raise ValueError(
                f"cells of shape {self.cells.shape}; {self.kind} cells are "
                f"(n_cells, {cell.n_nodes})."
            )
        if self.cells.min() < 0 or self.cells.max() >= len(self.points):
            raise ValueError(
                f"cells name nodes {self.cells.min()} to {self.cells.max()}; the mesh has "
                f"{len(self.points)} points, counted from 0."
            )
        unused = np.flatnonzero(np.bincount(self.cells.ravel(), minlength=len(self.points)) == 0)
        if unused.size:
            raise ValueError(f"node {unused[0]} belongs to no cell; every node needs one.")
        slopes = cell.gradient(cell.nodes)
        with np.errstate(over="ignore", invalid="ignore"):  # of points that are out of all bounds
            x, y = (self.points[self.cells, axis] @ slopes.transpose(2, 1, 0) for axis in (0, 1))
            determinants = x[0] * y[1] - x[1] * y[0]
        whole = np.abs(np.sign(determinants).sum(axis=1)) == cell.n_nodes
        folded = np.flatnonzero(~whole)
        if folded.size:
            raise ValueError(f"cell {folded[0]} is folded or flat; no pixel can be placed in it.")

    @property
    def cell(self) -> PlaneCell:
        """The kind of its cells."""
        return CELLS[self.kind]

    @property
    def corners(self) -> IntArray:
        """Nodes at the corners of each cell, in order around it, shape (n_cells, n_corners)."""
        return self.cells[:, : self.cell.n_corners]

    @property
    def size(self) -> float:
        """Side of a square as large as the mean cell [µm]."""
        corners = self.points[self.corners]
        following = np.roll(corners, -1, axis=1)
        areas = corners[..., 0] * following[..., 1] - corners[..., 1] * following[..., 0]
        return float(np.sqrt(np.mean(0.5 * np.abs(areas.sum(axis=1)))))

    def locate(self, xy: FloatArray) -> tuple[IntArray, FloatArray]:
        """Cell that holds each point, and where in it.

        Args:
            xy: points [µm], shape (n, 2).

        Returns:
            cell of each point, −1 for one outside the mesh, shape (n,); reference coordinates,
            shape (n, 2).
        """
        point, cell = self._near(xy)
        nodes = self.points[self.cells]
        at = _inverse_map(self.cell, nodes[cell], xy[point])
        inside = self.cell.excess(at) <= TOLERANCE
        # The first of several cells that hold a point takes it: what is written last stays.
        held = np.flatnonzero(inside)[::-1]
        cells = np.full(len(xy), -1, dtype=np.int64)
        local = np.zeros((len(xy), 2))
        cells[point[held]], local[point[held]] = cell[held], at[held]
        return cells, local

    def gradients(self, cell: IntArray, local: FloatArray) -> FloatArray:
        """Return derivatives along X and Y of the functions of a cell at located points [1/µm].

        Args:
            cell: cell of each point, shape (n,).
            local: reference coordinates there, shape (n, 2).

        Returns:
            In the order of the nodes of the cell, shape (n, nodes of the kind, 2).
        """
        slopes = self.cell.gradient(local)
        jacobian = self.points[self.cells[cell]].transpose(0, 2, 1) @ slopes
        return np.asarray(slopes @ np.linalg.inv(jacobian))

    def _near(self, xy: FloatArray) -> tuple[IntArray, IntArray]:
        """Return pairs of a point and a cell whose box holds it, in the order of the cells."""
        order = np.argsort(xy[:, 1], kind="stable")
        x, y = xy[order].T
        nodes = self.points[self.cells]
        # A curved side may leave the box of its nodes by less than an eighth of its length.
        slack = np.where(self.cell.n_nodes > self.cell.n_corners, 0.125, 1e-9) * np.ptp(nodes, 1)
        low, high = nodes.min(axis=1) - slack, nodes.max(axis=1) + slack
        first = np.searchsorted(y, low[:, 1], side="left")
        last = np.searchsorted(y, high[:, 1], side="right")
        near = [
            order[i:j][(x[i:j] >= low[k, 0]) & (x[i:j] <= high[k, 0])]
            for k, (i, j) in enumerate(zip(first, last, strict=True))
        ]
        return np.concatenate(near), np.repeat(np.arange(len(near)), [len(n) for n in near])

    def interpolation(self, cell: IntArray, local: FloatArray) -> sp.csr_array:
        """Values at located points as linear combinations of nodal values, (n, n_nodes)."""
        n, m = len(cell), self.cell.n_nodes
        indptr = np.arange(0, m * n + 1, m)
        data = self.cell.shape(local).ravel()
        return sp.csr_array((data, self.cells[cell].ravel(), indptr), shape=(n, len(self.points)))


def _inverse_map(cell: PlaneCell, nodes: FloatArray, xy: FloatArray) -> FloatArray:
    """Return reference coordinates (n, 2) of points, each in the cell of its nodes (n, m, 2)."""
    at = np.tile(cell.centre, (len(xy), 1))
    scale = np.ptp(nodes, axis=1).max(axis=1)
    left = np.arange(len(xy))
    for _ in range(NEWTON_STEPS):
        miss = xy[left] - (cell.shape(at[left])[:, None] @ nodes[left])[:, 0]
        jacobian = nodes[left].transpose(0, 2, 1) @ cell.gradient(at[left])
        step = np.linalg.solve(jacobian, miss[..., None])[..., 0]
        at[left] = np.clip(at[left] + step, -3.0, 3.0)
        left = left[np.abs(miss).max(axis=1) >= 1e-13 * scale[left]]
        if not left.size:
            break
    return at
