"""The mesh of a specimen as one value: points, quadratic cells, grains and named faces."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

FACE_GROUPS = ("S_PLUS", "S_MINUS", "TOP")
EDGE_GROUPS = ("L_PLUS", "L_MINUS")
POINT_GROUPS = ("P_PLUS", "P_MINUS")


@dataclass(frozen=True, eq=False)
class PrismMesh:
    """A tet10 mesh of the prism in the specimen frame (docs/method.md).

    Attributes:
        points: node coordinates [µm], shape (n_nodes, 3).
        cells: tet10 connectivity in VTK order (4 corners, then the mid-edge nodes of
            01, 12, 02, 03, 13, 23), shape (n_cells, 10), every Jacobian positive.
        grain: index of the grain of each cell (0 = GRAIN1), shape (n_cells,).
        faces: for each of S_PLUS, S_MINUS, TOP the tri6 faces as node indices
            (3 corners, then the mid-edge nodes of 01, 12, 20), shape (n, 6).
        nodes: for every group (the faces above, L_PLUS, L_MINUS, P_PLUS, P_MINUS) the sorted
            indices of its nodes, mid-edge nodes included, shape (n,).
    """

    points: FloatArray
    cells: IntArray
    grain: IntArray
    faces: Mapping[str, IntArray]
    nodes: Mapping[str, IntArray]

    @property
    def n_grains(self) -> int:
        """Number of grains."""
        return int(self.grain.max()) + 1
