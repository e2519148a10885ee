"""What the mesh leaves wrong: how much of it two meshes tell, and how large the rest is.

Hexahedra of two sizes are meshes of one family, swept over the same section: their errors keep
their shape and fall with the power `ORDER` of the size, so that the finer one's error is known from
what both differ by (Richardson's extrapolation). Tetrahedra of two sizes are meshes of their own:
their error falls, but its shape does not stay, and nothing can be added. What is left either way is
known by its size alone (benchmarks/numerics.md).
"""

from __future__ import annotations

from meshes.prism_mesh import PrismMesh

ORDER = 1.5
"""Power of the size with which the error of hexahedra falls; from 2 to 1 µm 1.4 was measured."""
_LARGEST = 0.8  # ratio of sizes; a case has at most 0.7, which whole numbers of cells change
_LEFT = 0.2  # of the extrapolated difference of two meshes of hexahedra; 0.10 to 0.15 was measured
_HEXAHEDRON = 20  # nodes


def extrapolation(working: PrismMesh, finer: PrismMesh) -> float:
    """Share of the finer-minus-working difference that the finer mesh itself still lacks.

    0 for meshes of no family, and for one that is hardly finer.
    """
    nodes = {mesh.cells.shape[1] for mesh in (working, finer)}
    ratio: float = (len(working.cells) / len(finer.cells)) ** (1.0 / 3.0)
    if nodes != {_HEXAHEDRON} or ratio > _LARGEST:
        return 0.0
    fallen: float = ratio**ORDER
    return fallen / (1.0 - fallen)


def share_left(nodes: int, ratio: float) -> float:
    """Return what a corrected prediction leaves wrong over the correction, root mean square.

    Args:
        nodes: those of a cell.
        ratio: element size of the finer over that of the working mesh.
    """
    if nodes == _HEXAHEDRON:
        return _LEFT
    # The first power of the size, measured on meshes of 262, 574 and 1414 tetrahedra.
    return ratio / (1.0 - ratio)


def variance_left(nodes: int, ratio: float) -> float:
    """Return the mean square that a corrected prediction leaves over that of the correction.

    Two meshes of tetrahedra err each in its own way, in proportion to their sizes: the finer one
    keeps the share r²/(1 + r²). (A test of known truth on 942 cells, identified with 262 and 574,
    confirms it: what the correction leaves has a cosine of −0.40 to it, and such errors give
    −0.44.)

    Args:
        nodes: those of a cell.
        ratio: element size of the finer over that of the working mesh.
    """
    if nodes == _HEXAHEDRON:
        return share_left(nodes, ratio) ** 2
    return ratio**2 / (1.0 + ratio**2)
