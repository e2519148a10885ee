"""The measures of a specimen that a mesh file tells."""

from __future__ import annotations

from dataclasses import dataclass

from meshes.prism import CellKind


@dataclass(frozen=True)
class Measures:
    """What a case takes from its mesh.

    Attributes:
        length, width, depth: along Y, of the measured face along X, and below it [µm].
        area: volume over length [µm²].
        size: mean edge of the tetrahedra, or root of the mean area of the hexahedra on S_MINUS
            [µm].
        kind: of the cells.
        n_grains: number of grains.
        end_faces: faces of S_MINUS.
    """

    length: float
    width: float
    depth: float
    area: float
    size: float
    kind: CellKind
    n_grains: int
    end_faces: int
