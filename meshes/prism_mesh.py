"""The mesh of a specimen as one value: points, quadratic cells, grains and named faces."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from meshes.arrays import FloatArray, IntArray

FACE_GROUPS = ("S_PLUS", "S_MINUS", "TOP")


@dataclass(frozen=True, eq=False)
class PrismMesh:
    """A mesh of the prism, of tet10 or hex20 cells, in the specimen frame (docs/method).

    Attributes:
        points: node coordinates [µm], shape (n_nodes, 3).
        cells: connectivity in VTK order, every Jacobian positive: tet10, shape (n_cells, 10)
            (4 corners, then the mid-edge nodes of 01, 12, 02, 03, 13, 23), or hex20, shape
            (n_cells, 20) (8 corners, then those of 01, 12, 23, 30, 45, 56, 67, 74, 04, 15, 26,
            37).
        grain: index of the grain of each cell (0 = GRAIN1), shape (n_cells,).
        faces: for each of S_PLUS, S_MINUS, TOP the faces as node indices, outward normal: of tet10
            cells tri6, shape (n, 6) (3 corners, then the mid-edge nodes of 01, 12, 20), of hex20
            cells quad8, shape (n, 8) (4 corners, then those of 01, 12, 23, 30).
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
