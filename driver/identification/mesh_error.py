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
"""Power of the size with which the error of hexahedra falls, measured."""
_LEFT = 0.2  # of the extrapolated difference of two meshes of hexahedra, measured
_HEXAHEDRON = 20  # nodes


def extrapolation(working: PrismMesh, finer: PrismMesh) -> float:
    """Share of the finer-minus-working difference that the finer mesh itself still lacks.

    0 for meshes of no family, and for one that is not finer.
    """
    nodes = {mesh.cells.shape[1] for mesh in (working, finer)}
    if nodes != {_HEXAHEDRON} or len(finer.cells) <= len(working.cells):
        return 0.0
    fallen: float = (len(working.cells) / len(finer.cells)) ** (ORDER / 3.0)
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
