"""Scalar finite-element bases on the measured surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Basis:
    """Bilinear Q4 functions on a regular grid.

    Attributes:
        values: each function at each pixel of the region of interest,
            shape (n_pixels, n_functions).
        nodes: position of the node of each function [µm], Y running fastest,
            shape (n_functions, 2).
        bounds: rectangle (x0, x1, y0, y1) of the grid [µm].
        cells: number of elements along X and Y.
    """

    values: csr_array
    nodes: FloatArray
    bounds: tuple[float, float, float, float]
    cells: tuple[int, int]

    def at(self, points: FloatArray) -> csr_array:
        """The functions at any points of the grid.

        Args:
            points: X, Y [µm], shape (n, 2).

        Returns:
            Values, shape (n, n_functions).

        Raises:
            ValueError: a point lies outside the bounds.
        """
        return _bilinear(points, self.bounds, self.cells)


def grid_basis(
    xy: FloatArray, bounds: tuple[float, float, float, float], element_size: float
) -> Basis:
    """Q4 basis on a regular grid that fills the bounds.

    Args:
        xy: pixels of the region of interest [µm], shape (n_pixels, 2).
        bounds: rectangle (x0, x1, y0, y1) that holds them [µm].
        element_size: wanted size of an element [µm]; the nearest size that divides each
            side of the rectangle is taken.

    Raises:
        ValueError: a pixel lies outside the bounds.
    """
    x0, x1, y0, y1 = bounds
    cells = (max(1, round((x1 - x0) / element_size)), max(1, round((y1 - y0) / element_size)))
    x, y = np.meshgrid(
        np.linspace(x0, x1, cells[0] + 1), np.linspace(y0, y1, cells[1] + 1), indexing="ij"
    )
    nodes = np.column_stack([x.ravel(), y.ravel()])
    return Basis(values=_bilinear(xy, bounds, cells), nodes=nodes, bounds=bounds, cells=cells)


def _bilinear(
    points: FloatArray, bounds: tuple[float, float, float, float], cells: tuple[int, int]
) -> csr_array:
    lower, upper = np.array(bounds).reshape(2, 2).T
    n_cells = np.array(cells)
    place = (points - lower) / (upper - lower) * n_cells
    if np.any(place < -1e-9) or np.any(place > n_cells + 1e-9):
        worst = points[np.argmax(np.abs(place / n_cells - 0.5).max(axis=1))]
        raise ValueError(f"point {tuple(worst)} µm lies outside the bounds {bounds} of the basis.")
    cell = np.clip(place.astype(np.int64), 0, n_cells - 1)
    t = place - cell
    corner = np.array([[0, 0], [0, 1], [1, 0], [1, 1]])
    weights = np.prod(np.where(corner, t[:, None, :], 1.0 - t[:, None, :]), axis=2)
    node = (cell[:, None, 0] + corner[:, 0]) * (cells[1] + 1) + cell[:, None, 1] + corner[:, 1]
    pixels = np.repeat(np.arange(len(points)), 4)
    shape = (len(points), (cells[0] + 1) * (cells[1] + 1))
    return csr_array((weights.ravel(), (pixels, node.ravel())), shape=shape)
