"""Sizes of the elements of the working and of the finer mesh where none are stated.

Hexahedra have whole numbers of cells along half of the longest side of the section: 1 and 2 of
them at first, then 1 and 3, 1 and 4, 2 and 5. The finer simulation counts to first order in all
parameters, so that the working mesh need not be fine. The edges of a mesh of the user's own are
parted into as many pieces. Tetrahedra of 4 µm of width have 1.6 and
1.11 µm at first, and two thirds of both with each refinement.
"""

from __future__ import annotations

from meshes.prism import CellKind
from meshes.section import Section

LARGEST_RATIO = 0.7
"""Of the finer size of hexahedra to the working one, up to which both tell of the error."""
_HEXAHEDRA = (1, 2)  # cells along half of the longest side
_TETRAHEDRA = (1 / 2.5, 1 / 3.6)  # of the width
_TWO_THIRDS = 2 / 3

Sizes = tuple[float, float]


def sizes_at(section: Section, kind: CellKind, level: int) -> Sizes:
    """Return the sizes of the working and of the finer mesh after refinements [µm].

    Args:
        section: of the specimen.
        kind: of the cells.
        level: how often they were refined.
    """
    if kind == "hex20":
        sizes = _of_divisions(section, _HEXAHEDRA)
    else:
        sizes = _rounded(*(share * section.width for share in _TETRAHEDRA))
    for _ in range(level):
        sizes = refined_sizes(section, kind, sizes)
    return sizes


def refined_sizes(section: Section, kind: CellKind, sizes: Sizes) -> Sizes:
    """Return the next smaller sizes of the meshes [µm]; of hexahedra the finer one goes first.

    Args:
        section: of the specimen.
        kind: of the cells.
        sizes: of the working and of the finer mesh [µm].
    """
    if kind == "tet10":
        return _rounded(*(_TWO_THIRDS * size for size in sizes))
    working, finer = (section.divisions(size) for size in sizes)
    return _of_divisions(section, next_divisions(working, finer))


def sizes_in_pieces(size: float, level: int) -> Sizes:
    """Return the sizes after refinements of a mesh of the user's own, whose edges are parted [µm].

    Args:
        size: of the cells of the mesh as it is [µm].
        level: how often both meshes were refined.
    """
    pieces = _HEXAHEDRA
    for _ in range(level):
        pieces = next_divisions(*pieces)
    return sizes_of_pieces(size, pieces)


def sizes_of_pieces(size: float, pieces: tuple[int, int]) -> Sizes:
    """Return the sizes of the working and of the finer mesh of so many pieces of an edge [µm].

    Args:
        size: of the cells of the mesh as it is [µm].
        pieces: of each edge in the working and in the finer mesh.
    """
    return _rounded(*(size / number for number in pieces))


def next_divisions(working: int, finer: int) -> tuple[int, int]:
    """Return the divisions of the working and of the finer mesh after one more refinement."""
    return max(working, finer // 2), finer + 1


def _of_divisions(section: Section, divisions: tuple[int, int]) -> Sizes:
    return _rounded(*(section.longest_side / 2 / number for number in divisions))


def _rounded(working: float, finer: float) -> Sizes:
    """Return sizes as they are told, so that what is told can be written into a case."""
    return float(f"{working:.3g}"), float(f"{finer:.3g}")
