"""The prism of grains in a row, triangular or a bar: its geometry and its conforming meshes.

Tetrahedra are made by gmsh, hexahedra by sweeping quadrilaterals of the section.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from math import isfinite, prod, sqrt
from types import ModuleType
from typing import Any, Literal

import numpy as np

from meshes.arrays import FloatArray, IntArray
from meshes.cells import inverted_cells, outer_faces
from meshes.gmsh_library import running_gmsh
from meshes.grain_boundary import GrainBoundary, fault_of
from meshes.hex20 import swept_quadrilateral, swept_triangle
from meshes.prism_mesh import PrismMesh
from meshes.section import Section
from meshes.tet10 import node_groups

SIDES = ("length", "width", "depth")
CellKind = Literal["tet10", "hex20"]

LAYER = 0.6
"""Thickness of a layer of hexahedra over their width: slip varies most along the axis."""

MOST_CELLS = 200_000
"""Cells of a mesh beyond which no simulation ends on any machine that people have."""
MOST_SLENDER = 100.0
"""Ratio of two sides of a prism beyond which its cells would be flat or needles."""
_CELLS_IN_A_CUBE = {"tet10": 8.5, "hex20": 3.0}  # whose edge is the size of the cells

_GMSH_TET10 = 11
# gmsh numbers the mid-edge nodes of 13 and 23 the other way round than VTK.
_GMSH_TO_VTK = np.array([0, 1, 2, 3, 4, 5, 6, 7, 9, 8])


@dataclass(frozen=True)
class PrismGeometry:
    """A triangular prism or a bar along Y, cut into grains by planes.

    The measured face is −width/2 ≤ X ≤ width/2, 0 ≤ Y ≤ length, Z = 0; the apex line, or the far
    side of a bar, lies at Z = −depth about X = 0; the end faces are S_MINUS at Y = 0 and S_PLUS at
    Y = length.

    Attributes:
        length: length along Y [µm].
        width: width of the measured face [µm].
        depth: distance of the apex line or far side from the measured face [µm].
        boundaries: planes between neighbouring grains, in the order of the grains; each normal
            points from one grain to the next. None of a single grain.
        bottom: width of the far side [µm], 0 of a triangular prism.

    Raises:
        ValueError: a dimension is not positive or more than MOST_SLENDER times another, the far
            side is not 0 or more, or of several boundaries one has a fault.
    """

    length: float = 12.0
    width: float = 4.0
    depth: float = 2 * sqrt(3)
    boundaries: tuple[GrainBoundary, ...] = ()
    bottom: float = 0.0

    def __post_init__(self) -> None:
        """Refuse what is not a prism."""
        for name in SIDES:
            value = getattr(self, name)
            if not (isfinite(value) and value > 0):
                raise ValueError(f"prism {name} is {value} µm; it must be positive")
        if not (isfinite(self.bottom) and self.bottom >= 0):
            raise ValueError(f"prism bottom is {self.bottom} µm; it must be 0 or more")
        sides = (*SIDES, "bottom") if self.bottom else SIDES
        least, most = min(sides, key=self.__getattribute__), max(sides, key=self.__getattribute__)
        if getattr(self, most) > MOST_SLENDER * getattr(self, least):
            raise ValueError(
                f"prism {most} is {getattr(self, most):g} µm and its {least} "
                f"{getattr(self, least):g} µm; a ratio of at most {MOST_SLENDER:g} is expected"
            )
        fault = fault_of(self.boundaries, self.section, self.length)
        if fault is not None:
            raise ValueError(
                f"grain boundary {fault.number}: found {fault.found}, expected {fault.expected}"
            )

    @property
    def section(self) -> Section:
        """The section."""
        return Section(self.width, self.depth, self.bottom)

    @property
    def corners(self) -> FloatArray:
        """Corners of the prism [µm], those at Y = 0 first, shape (6 or 8, 3)."""
        return self.section.corners_between(0.0, self.length)

    @property
    def n_grains(self) -> int:
        """Number of grains."""
        return len(self.boundaries) + 1

    @property
    def along_y(self) -> bool:
        """Whether the numbers of the grains grow along Y."""
        return not self.boundaries or self.boundaries[0].normal[1] > 0

    @property
    def crossed_from_side_to_side(self) -> bool:
        """Whether no grain boundary, if there is one, meets an end face."""
        try:
            self.heights(self.corners)
        except ValueError:
            return False
        return True

    def heights(self, points: FloatArray) -> list[FloatArray]:
        """Y of each grain boundary [µm] at the X and Z of each point (n, 3), shapes (n,).

        Raises:
            ValueError: a grain boundary meets an end face at one of them.
        """
        return [boundary.height(points, self.length) for boundary in self.boundaries]

    def grain_at(self, points: FloatArray) -> IntArray:
        """Index of the grain that holds each point (n, 3), shape (n,)."""
        grain = np.zeros(len(points), dtype=np.int64)
        for boundary in self.boundaries:
            grain += boundary.distance(points) > 0
        return grain


def generate(
    geometry: PrismGeometry,
    size: float,
    kind: CellKind = "tet10",
    layers: tuple[int, ...] | None = None,
) -> PrismMesh:
    """Mesh the prism with straight-sided quadratic cells that conform to the grain boundaries.

    The same input always gives the same arrays.

    Args:
        geometry: the prism and its grain boundaries.
        size: edge length of the cells, of hexahedra across the section [µm].
        kind: tetrahedra, or hexahedra in layers along Y that lean with the grain boundaries.
        layers: number of layers of hexahedra in each grain, of equal share; None for a thickness
            of LAYER × size along the centre line.

    Returns:
        the mesh, every Jacobian positive.

    Raises:
        ValueError: the size is not positive or makes more than MOST_CELLS, a boundary leaves a
            grain empty, or it meets an end face, which layers of hexahedra cannot follow; layers
            of tetrahedra, or none in a grain.
        RuntimeError: gmsh could not mesh the prism.
    """
    if not (isfinite(size) and size > 0):
        raise ValueError(f"element size is {size} µm; it must be positive")
    refuse_too_many(geometry, size, kind)
    _refuse_empty_grains(geometry)
    if kind == "hex20":
        return _layers(geometry, size, layers)
    if layers is not None:
        raise ValueError(f"layers are {layers} for a mesh of {kind}; hex20 alone has layers")
    points, cells, _ = tetrahedra(lambda gmsh: _build(gmsh, geometry), size)
    if len(inverted_cells(points, cells)):
        raise RuntimeError(
            f"gmsh made inverted cells with element size {size} µm; another size is needed"
        )
    grain = geometry.grain_at(points[cells[:, :4]].mean(axis=1))
    faces = named_faces(geometry, points, cells)
    return PrismMesh(points, cells, grain, faces, node_groups(points, faces))


def expected_cells(geometry: PrismGeometry, size: float, kind: CellKind) -> float:
    """Return about how many cells of a size [µm] a prism holds, by its volume."""
    section = geometry.section
    if kind == "hex20" and section.bottom:
        return (
            prod(section.quadrilaterals(section.divisions(size))) * geometry.length / LAYER / size
        )
    volume = geometry.length * section.area
    return _CELLS_IN_A_CUBE[kind] * volume / size**3


def refuse_too_many(geometry: PrismGeometry, size: float, kind: CellKind) -> None:
    """Refuse a size before gmsh takes minutes and gigabytes for it.

    Raises:
        ValueError: the mesh would have more cells than MOST_CELLS.
    """
    cells = expected_cells(geometry, size, kind)
    if cells > MOST_CELLS:
        least = size * (cells / MOST_CELLS) ** (1 / 3)
        raise ValueError(
            f"elements of {size:g} µm would be about {cells:.1g} cells; at most {MOST_CELLS} are "
            f"expected, as of {least:.2g} µm or more"
        )


def _layers(geometry: PrismGeometry, size: float, layers: tuple[int, ...] | None) -> PrismMesh:
    """Hexahedra: the section in quadrilaterals, swept in layers of equal share of each grain."""
    section, length, n_grains = geometry.section, geometry.length, geometry.n_grains
    corners, divisions = section.corners, section.divisions(size)
    middle = np.array([[corners[:, 0].mean(), 0.0, corners[:, 1].mean()]])
    geometry.heights(geometry.corners)
    # From here to the grains of the mesh grains are counted along Y.
    order = slice(None, None, 1 if geometry.along_y else -1)
    ends = [0.0, *(float(h[0]) for h in geometry.heights(middle)[order]), length]
    counts = [max(1, round((end - start) / (LAYER * size))) for start, end in pairwise(ends)]
    if layers is not None:
        counts = list(layers[order])
        if len(counts) != n_grains or min(counts) < 1:
            grains = f"{n_grains} grains" if n_grains > 1 else "one grain"
            expected = f"({', '.join('1' * n_grains)}{',' * (n_grains == 1)}) or more"
            raise ValueError(f"layers are {layers} in a prism of {grains}; {expected} are expected")
    starts = np.cumsum([0, *counts])
    if section.bottom:
        swept = swept_quadrilateral(*section.quadrilaterals(divisions), int(starts[-1]))
    else:
        swept = swept_triangle(divisions, int(starts[-1]))
    shares, layer, cells, faces = swept
    points = np.zeros((len(shares), 3))
    points[:, [0, 2]] = shares @ corners
    whole = np.full(len(points), length)
    heights = [np.zeros(len(points)), *geometry.heights(points)[order], whole]
    for number, (lower, upper) in enumerate(pairwise(heights)):
        inside = layer > starts[number] if number else layer >= 0
        risen = (upper - lower) * (layer - starts[number]) / counts[number]
        points[inside, 1] = (lower + risen)[inside]
    points[layer == starts[-1], 1] = length
    along = np.searchsorted(starts[1:-1], layer[cells].mean(axis=1)).astype(np.int64)
    grain = along if geometry.along_y else n_grains - 1 - along
    return PrismMesh(points, cells, grain, faces, node_groups(points, faces))


def _refuse_empty_grains(geometry: PrismGeometry) -> None:
    tolerance = 1e-6 * geometry.length
    for number, boundary in enumerate(geometry.boundaries, start=1):
        distance = boundary.distance(geometry.corners)
        if distance.min() > -tolerance or distance.max() < tolerance:
            empty = number if distance.min() > -tolerance else number + 1
            raise ValueError(f"{boundary} does not cut the prism: grain {empty} is empty")


def tetrahedra(
    build: Callable[[ModuleType], None], size: float
) -> tuple[FloatArray, IntArray, IntArray]:
    """Mesh solids of gmsh by tetrahedra of a size.

    Args:
        build: makes the solids in the module that it gets.
        size: edge of the cells [µm].

    Returns:
        points, shape (n, 3); tet10 cells in VTK order, shape (m, 10); number of the solid of each,
        shape (m,).

    Raises:
        RuntimeError: gmsh could not mesh them.
    """
    with running_gmsh() as gmsh:
        try:
            for option, value in {
                "General.Terminal": 0,
                "General.NumThreads": 1,
                "Mesh.RandomSeed": 1,
                "Mesh.MeshSizeMin": size,
                "Mesh.MeshSizeMax": size,
                "Mesh.ElementOrder": 2,
                # Improve most cells, not only slivers; gmsh's other optimiser (Netgen) would
                # double the number of cells and leave worse ones.
                "Mesh.OptimizeThreshold": 0.6,
            }.items():
                gmsh.option.setNumber(option, value)
            build(gmsh)
            gmsh.model.mesh.generate(3)
            return _tet10(gmsh)
        except Exception as error:  # gmsh raises bare Exception
            raise RuntimeError(f"gmsh could not mesh the prism: {error}") from error


def _build(gmsh: ModuleType, geometry: PrismGeometry) -> None:
    prism = solid_of(gmsh, geometry)
    squares = [_boundary_square(geometry, boundary) for boundary in geometry.boundaries]
    if squares:
        occ = gmsh.model.occ
        occ.fragment(prism, [(2, _polygon(occ, square)) for square in squares])
    keep_solids(gmsh)


def solid_of(gmsh: ModuleType, geometry: PrismGeometry) -> list[tuple[int, int]]:
    """Make the prism as a solid of gmsh, and return it."""
    occ, corners = gmsh.model.occ, geometry.corners
    section = _polygon(occ, corners[: len(corners) // 2])
    extruded = occ.extrude([(2, section)], 0, geometry.length, 0)
    return [entity for entity in extruded if entity[0] == 3]


def keep_solids(gmsh: ModuleType) -> None:
    """Remove faces that bound no solid: what sticks out of the prism is no part of the mesh."""
    gmsh.model.occ.synchronize()
    inside = gmsh.model.getBoundary(gmsh.model.getEntities(3), combined=False, oriented=False)
    gmsh.model.removeEntities(
        [face for face in gmsh.model.getEntities(2) if face not in inside], recursive=True
    )


def _polygon(occ: Any, corners: FloatArray) -> int:
    points = [occ.addPoint(*corner) for corner in corners]
    lines = [occ.addLine(a, b) for a, b in zip(points, points[1:] + points[:1], strict=True)]
    surface: int = occ.addPlaneSurface([occ.addCurveLoop(lines)])
    return surface


def _boundary_square(geometry: PrismGeometry, boundary: GrainBoundary) -> FloatArray:
    """Corners of a square in a boundary plane that covers the whole prism, shape (4, 3)."""
    corners = geometry.corners
    centre = corners.mean(axis=0)
    normal = boundary.unit_normal
    origin = centre - boundary.distance(centre) * normal
    first = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    first /= np.linalg.norm(first)
    second = np.cross(normal, first)
    reach = 2 * float(np.linalg.norm(corners - centre, axis=1).max())
    signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    square: FloatArray = origin + reach * (signs @ np.array([first, second]))
    return square


def _tet10(gmsh: ModuleType) -> tuple[FloatArray, IntArray, IntArray]:
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    elements, connectivity = gmsh.model.mesh.getElementsByType(_GMSH_TET10)
    used, cells = np.unique(np.asarray(connectivity, dtype=np.int64), return_inverse=True)
    order = np.argsort(tags)
    rows = order[np.searchsorted(np.asarray(tags)[order], used)]
    points = np.asarray(coordinates, dtype=np.float64).reshape(-1, 3)[rows]
    solid = np.zeros(len(elements), dtype=np.int64)
    for _, tag in gmsh.model.getEntities(3):
        own, _ = gmsh.model.mesh.getElementsByType(_GMSH_TET10, tag)
        solid[np.isin(elements, own)] = tag
    return points, cells.reshape(-1, 10)[:, _GMSH_TO_VTK], solid


def named_faces(
    geometry: PrismGeometry, points: FloatArray, cells: IntArray
) -> dict[str, IntArray]:
    """Return named faces; their nodes, off by gmsh's round-off, are put exactly on the planes."""
    outer, _ = outer_faces(cells)
    planes = {"S_PLUS": (1, geometry.length), "S_MINUS": (1, 0.0), "TOP": (2, 0.0)}
    faces = {}
    for name, (axis, value) in planes.items():
        on_plane = np.abs(points[:, axis] - value) < 1e-8 * geometry.length
        points[on_plane, axis] = value
        faces[name] = outer[on_plane[outer].all(axis=1)]
    return faces
