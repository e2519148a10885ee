"""How much the mesh leaves wrong in a corrected prediction.

Its size alone is known (benchmarks/numerics.md). The motion of extrapolated hexahedra errs in
proportion to the power 2.4 of their size, that of a working prediction in proportion to its size,
and an extrapolated load by a share of itself that falls with the second power; all hang on how many
cells the section has. Two meshes of tetrahedra err each in its own way, in proportion to their
sizes.
"""

from __future__ import annotations

import numpy as np

from meshes.arrays import FloatArray
from meshes.prism_mesh import PrismMesh
from meshes.section import Section

_HEXAHEDRON = 20  # nodes
_LEFT, _POWER = 2.2, 2.4
"""Of the error of one cell on half of a side m cells leave this over this power of m, extrapolated:
0.42 with 2 and 0.16 with 3, root mean square of ten specimens, 0.075 with 4, of one."""
_LOAD_LEFT = 0.0094
"""m² times the share of itself by which an extrapolated load is off: 0.0097 with m = 2 and 0.0095
with 3, root mean square of ten specimens."""


def share_left(mesh: PrismMesh, sizes: tuple[float, float]) -> float:
    """Return what a corrected motion leaves wrong over the correction, root mean square.

    Args:
        mesh: the working mesh.
        sizes: of the cells of the working and of the finer mesh [µm].
    """
    if mesh.cells.shape[1] == _HEXAHEDRON:
        section = Section.of(mesh.points)
        working, finer = (section.divisions(size) for size in sizes)
        return float(min(_LEFT * working / finer**_POWER, 1.0))
    # The first power of the size, measured on meshes of 262, 574 and 1414 tetrahedra.
    return sizes[1] / (sizes[0] - sizes[1])


def load_left(
    mesh: PrismMesh, sizes: tuple[float, float], change: FloatArray, load: FloatArray
) -> FloatArray:
    """Return what a corrected load leaves wrong [µN], a standard deviation in each image, (T,).

    Of hexahedra it is a share of the load, for their correction may pass through nothing where both
    meshes are as wrong as each other. Of tetrahedra it is a share of the correction.

    Args:
        mesh: the working mesh.
        sizes: of the cells of the working and of the finer mesh [µm].
        change: the correction of the load as far as it is of the mesh [µN], (T,).
        load: as measured [µN], (T,).
    """
    if mesh.cells.shape[1] != _HEXAHEDRON:
        return share_left(mesh, sizes) * change
    return _LOAD_LEFT / Section.of(mesh.points).divisions(sizes[1]) ** 2 * load


def patterns_left(
    mesh: PrismMesh,
    sizes: tuple[float, float],
    change: tuple[FloatArray, FloatArray],
    load: FloatArray,
) -> list[tuple[FloatArray, FloatArray]]:
    """Return patterns of what is left, one standard deviation of each, independent of each other.

    They stand where crystals yield, as the correction does, which tells them from the field that
    the covariance counts. Two meshes of tetrahedra err each in its own way, in proportion to their
    sizes: the finer one keeps the share r²/(1 + r²) of the mean square. (A test of known truth on
    942 cells, identified with 262 and 574, confirms it: what the correction leaves has a cosine of
    −0.40 to it, and such errors give −0.44.)

    Args:
        mesh: the working mesh.
        sizes: of the cells of the working and of the finer mesh [µm].
        change: the correction as far as it is of the mesh: motion at the pixels [µm], shape
            (T, n_pix, 3), and load [µN], (T,).
        load: as measured [µN], (T,).

    Returns:
        Motion and load of each pattern.
    """
    motion, of_load = change
    if mesh.cells.shape[1] == _HEXAHEDRON:
        left = load_left(mesh, sizes, of_load, load)
        return [
            (share_left(mesh, sizes) * motion, np.zeros_like(left)),
            (np.zeros_like(motion), left),
        ]
    square = (sizes[1] / sizes[0]) ** 2
    share = np.sqrt(square / (1.0 + square))
    return [(share * motion, share * of_load)]
