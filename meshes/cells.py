"""What tet10 and wedge15 cells have in common, by their number of nodes."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from meshes import tet10, wedge15

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

EDGES: Mapping[int, IntArray] = MappingProxyType({10: tet10.EDGES, 15: wedge15.EDGES})
"""Corners joined by the edges that carry the nodes after the corners."""

_JACOBIANS = {10: tet10.jacobians, 15: wedge15.jacobians}


def inverted_cells(points: FloatArray, cells: IntArray) -> IntArray:
    """Indices of the cells with a Jacobian that is not positive (NaN included), shape (n,)."""
    determinants = _JACOBIANS[cells.shape[1]](points, cells)
    return np.flatnonzero(~(determinants > 0).all(axis=1))
