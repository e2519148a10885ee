"""How much the mesh leaves wrong in a corrected prediction.

Its size alone is known (benchmarks/numerics.md). Extrapolated hexahedra err in proportion to the
third power of their size, and a working prediction in proportion to its size; both hang on how many
cells the section has. Two meshes of tetrahedra err each in its own way, in proportion to their
sizes.
"""

from __future__ import annotations

from meshes.prism_mesh import PrismMesh
from meshes.section import Section

_HEXAHEDRON = 20  # nodes
_LEFT = 3.6
"""m³ times the share of the error of one cell on half of a side that m cells leave, extrapolated:
0.45, 0.12, 0.06 and 0.03 were measured with 2, 3, 4 and 5."""


def share_left(mesh: PrismMesh, sizes: tuple[float, float]) -> float:
    """Return what a corrected prediction leaves wrong over the correction, root mean square.

    Args:
        mesh: the working mesh.
        sizes: of the cells of the working and of the finer mesh [µm].
    """
    if mesh.cells.shape[1] == _HEXAHEDRON:
        section = Section.of(mesh.points)
        working, finer = (section.divisions(size) for size in sizes)
        return min(_LEFT * working / finer**3, 1.0)
    # The first power of the size, measured on meshes of 262, 574 and 1414 tetrahedra.
    return sizes[1] / (sizes[0] - sizes[1])


def variance_left(mesh: PrismMesh, sizes: tuple[float, float]) -> float:
    """Return the mean square that a corrected prediction leaves over that of the correction.

    Two meshes of tetrahedra err each in its own way, in proportion to their sizes: the finer one
    keeps the share r²/(1 + r²). (A test of known truth on 942 cells, identified with 262 and 574,
    confirms it: what the correction leaves has a cosine of −0.40 to it, and such errors give
    −0.44.)

    Args:
        mesh: the working mesh.
        sizes: of the cells of the working and of the finer mesh [µm].
    """
    if mesh.cells.shape[1] == _HEXAHEDRON:
        return share_left(mesh, sizes) ** 2
    square = (sizes[1] / sizes[0]) ** 2
    return square / (1.0 + square)
