"""Grains of an EBSD map: neighbours on its grid whose crystals hardly differ."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from driver.experiment.ebsd.cubic_symmetry import disorientations
from driver.experiment.ebsd.headers import MOST_POINTS
from driver.experiment.ebsd.maps import EbsdMap
from driver.experiment.images.files import Refused
from meshes.arrays import FloatArray, IntArray

THRESHOLD = 5.0
"""Disorientation [degrees] between neighbours from which on a grain ends (ASTM E2627)."""
_MOST_CELLS = 8 * MOST_POINTS  # of the grid, on which a map may leave places empty
_OFF_GRID = 0.25  # of a step


def grain_numbers(points: EbsdMap) -> IntArray:
    """Return the number of the grain of each cubic point of a map.

    Args:
        points: the map.

    Returns:
        Grain of each point from 0, −1 of points that are not indexed or not cubic, shape (n,).

    Raises:
        Refused: the points lie on no grid.
    """
    first, second = _neighbours(points.x, points.y, grid_steps(points))
    cubic = points.cubic
    same = cubic[first] & (points.phase[first] == points.phase[second])
    first, second = first[same], second[same]
    angles = disorientations(points.rotations[first], points.rotations[second])
    joined = angles < np.deg2rad(THRESHOLD)
    first, second = first[joined], second[joined]
    n = points.x.size
    graph = coo_array((np.ones(first.size, dtype=np.int8), (first, second)), shape=(n, n))
    numbers: IntArray = connected_components(graph, directed=False)[1].astype(np.int64)
    # Those of other points are left out, and the rest is counted from 0.
    numbers[~cubic] = -1
    numbers[cubic] = np.unique(numbers[cubic], return_inverse=True)[1]
    return numbers


def grid_steps(points: EbsdMap) -> tuple[float, float]:
    """Return the steps along a row and from row to row [µm], as the header has them if it does."""
    if points.step is not None:
        return points.step
    first_row = points.y == points.y.min()
    along, across = _usual_step(points.x[first_row]), _usual_step(points.y)
    return along or across or 1.0, across or along or 1.0


def _usual_step(values: FloatArray) -> float:
    steps = np.diff(np.unique(values))
    steps = steps[steps > 1e-6 * np.ptp(values)]
    return float(np.median(steps)) if steps.size else 0.0


def _neighbours(
    x: FloatArray, y: FloatArray, steps: tuple[float, float]
) -> tuple[IntArray, IntArray]:
    """Pairs of neighbours: four of a point on a square grid, six on a hexagonal one.

    Rows of a hexagonal grid are shifted by half a step, so that columns are counted in halves.
    """
    if np.ptp(x) > _MOST_CELLS * steps[0] or np.ptp(y) > _MOST_CELLS * steps[1]:
        raise _no_grid(steps)
    halves, rows = (x - x.min()) / (steps[0] / 2), (y - y.min()) / steps[1]
    column, row = np.rint(halves).astype(np.int64), np.rint(rows).astype(np.int64)
    hexagonal = np.unique((column - row) % 2).size == 1 and bool((column % 2).any())
    n_rows, n_columns = int(row.max()) + 2, int(column.max()) + 3
    if not hexagonal:
        column += column % 2  # a square grid has no halves
    off = np.abs(rows - row).max(initial=0.0) > _OFF_GRID or n_rows * n_columns > _MOST_CELLS
    grid = np.full((1, 1) if off else (n_rows, n_columns), -1, dtype=np.int32)
    if not off:
        grid[row, column] = np.arange(x.size)
    off = off or np.count_nonzero(grid >= 0) < x.size
    if off:
        raise _no_grid(steps)
    shifts = ((0, 2), (1, 1), (1, -1)) if hexagonal else ((0, 2), (1, 0))
    first, second = [], []
    for down, right in shifts:
        there = (column + right >= 0) & (column + right < n_columns)
        mine = np.flatnonzero(there)
        other = grid[row[mine] + down, column[mine] + right]
        first.append(mine[other >= 0])
        second.append(other[other >= 0])
    if x.size > 1 and sum(map(len, first)) < x.size / 2:
        raise _no_grid(steps)
    return np.concatenate(first), np.concatenate(second).astype(np.int64)


def _no_grid(steps: tuple[float, float]) -> Refused:
    return Refused(
        f"points that do not lie on a grid of {steps[0]:g} × {steps[1]:g} µm",
        "a map on a square or a hexagonal grid along x and y",
    )
