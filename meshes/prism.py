"""The prism of one or two grains, triangular or a bar: its geometry and its conforming meshes.

Tetrahedra are made by gmsh, hexahedra by sweeping quadrilaterals of the section.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot, isfinite, prod, sqrt
from types import ModuleType
from typing import Any, Literal

import numpy as np

from meshes.arrays import FloatArray, IntArray
from meshes.cells import inverted_cells, outer_faces
from meshes.gmsh_library import running_gmsh
from meshes.hex20 import swept_quadrilateral, swept_triangle
from meshes.prism_mesh import PrismMesh
from meshes.section import Section
from meshes.tet10 import node_groups

Vector = tuple[float, float, float]
SIDES = ("length", "width", "depth")
_TINY, _HUGE = 1e-100, 1e100  # lengths of a normal whose square is a number
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
    """A triangular prism or a bar along Y, cut into two grains by a plane.

    The measured face is −width/2 ≤ X ≤ width/2, 0 ≤ Y ≤ length, Z = 0; the apex line, or the far
    side of a bar, lies at Z = −depth about X = 0; the end faces are S_MINUS at Y = 0 and S_PLUS at
    Y = length.

    Attributes:
        length: length along Y [µm].
        width: width of the measured face [µm].
        depth: distance of the apex line or far side from the measured face [µm].
        boundary_point: a point of the grain boundary [µm], or None for a single grain.
        boundary_normal: normal of the grain boundary, of any length, or None for a single
            grain; it points out of the first grain (index 0).
        bottom: width of the far side [µm], 0 of a triangular prism.

    Raises:
        ValueError: a dimension is not positive or more than MOST_SLENDER times another, the far
            side is not 0 or more, the boundary is only half given, or its normal is zero or not a
            finite one.
    """

    length: float = 12.0
    width: float = 4.0
    depth: float = 2 * sqrt(3)
    boundary_point: Vector | None = None
    boundary_normal: Vector | None = None
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
        if (self.boundary_point is None) != (self.boundary_normal is None):
            raise ValueError("the grain boundary needs both a point and a normal, or neither")
        if self.boundary_point is not None and self.boundary_normal is not None:
            numbers = (*self.boundary_point, *self.boundary_normal)
            if not all(map(isfinite, numbers)) or not _TINY < hypot(*self.boundary_normal) < _HUGE:
                raise ValueError(
                    f"grain boundary through {self.boundary_point} with normal "
                    f"{self.boundary_normal}: finite numbers and a non-zero normal are expected"
                )

    @property
    def section(self) -> Section:
        """The section."""
        return Section(self.width, self.depth, self.bottom)

    def boundary_distance(self, points: FloatArray) -> FloatArray:
        """Signed distance from the grain boundary [µm], negative in the first grain.

        Args:
            points: coordinates [µm], shape (..., 3).

        Returns:
            distance, shape (...).

        Raises:
            ValueError: the prism is a single grain.
        """
        if self.boundary_point is None or self.boundary_normal is None:
            raise ValueError("the prism is a single grain: it has no grain boundary")
        normal = np.asarray(self.boundary_normal, dtype=float)
        distance: FloatArray = (points - np.asarray(self.boundary_point)) @ (
            normal / np.linalg.norm(normal)
        )
        return distance

    @property
    def crossed_from_side_to_side(self) -> bool:
        """Whether the grain boundary, if there is one, meets no end face."""
        if self.boundary_point is None:
            return True
        try:
            self.boundary_height(_corners(self))
        except ValueError:
            return False
        return True

    def boundary_height(self, points: FloatArray) -> FloatArray:
        """Y of the grain boundary [µm] at the X and Z of each point (n, 3), shape (n,).

        Raises:
            ValueError: the grain boundary meets an end face at one of them, or there is none.
        """
        at_section = points * np.array([1.0, 0.0, 1.0])
        distance = self.boundary_distance(at_section)
        per_y = float(self.boundary_distance(at_section[0] + np.array([0, 1.0, 0])) - distance[0])
        if per_y != 0:
            height: FloatArray = -distance / per_y
            if 0 < height.min() and height.max() < self.length:
                return height
        raise ValueError(
            f"the grain boundary through {self.boundary_point} with normal "
            f"{self.boundary_normal} meets an end face or a side along the whole prism: it is "
            "expected to cross the prism from side to side"
        )


def generate(
    geometry: PrismGeometry,
    size: float,
    kind: CellKind = "tet10",
    layers: tuple[int, int] | None = None,
) -> PrismMesh:
    """Mesh the prism with straight-sided quadratic cells that conform to the grain boundary.

    The same input always gives the same arrays.

    Args:
        geometry: the prism and its grain boundary.
        size: edge length of the cells, of hexahedra across the section [µm].
        kind: tetrahedra, or hexahedra in layers along Y that lean with the grain boundary.
        layers: numbers of layers of hexahedra in the first and in the second grain (0 where there
            is none), of equal share; None for a thickness of LAYER × size along the centre line.

    Returns:
        the mesh, every Jacobian positive.

    Raises:
        ValueError: the size is not positive or makes more than MOST_CELLS, the boundary leaves one
            grain empty, or it meets an
            end face, which layers of hexahedra cannot follow; layers of tetrahedra, or none in a
            grain.
        RuntimeError: gmsh could not mesh the prism.
    """
    if not (isfinite(size) and size > 0):
        raise ValueError(f"element size is {size} µm; it must be positive")
    refuse_too_many(geometry, size, kind)
    if geometry.boundary_point is not None:
        _require_two_grains(geometry)
    if kind == "hex20":
        return _layers(geometry, size, layers)
    if layers is not None:
        raise ValueError(f"layers are {layers} for a mesh of {kind}; hex20 alone has layers")
    points, cells = _tet10_by_gmsh(geometry, size)
    if len(inverted_cells(points, cells)):
        raise RuntimeError(
            f"gmsh made inverted cells with element size {size} µm; another size is needed"
        )
    if geometry.boundary_point is None:
        grain = np.zeros(len(cells), dtype=np.int64)
    else:
        centres = points[cells[:, :4]].mean(axis=1)
        grain = (geometry.boundary_distance(centres) > 0).astype(np.int64)
    faces = _faces(geometry, points, cells)
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


def _layers(geometry: PrismGeometry, size: float, layers: tuple[int, int] | None) -> PrismMesh:
    """Hexahedra: the section in quadrilaterals, swept in layers of equal share of each grain."""
    section, length = geometry.section, geometry.length
    corners, divisions = section.corners, section.divisions(size)
    if geometry.boundary_point is None:
        parts = [length]
    else:
        middle = np.array([[corners[:, 0].mean(), 0.0, corners[:, 1].mean()]])
        geometry.boundary_height(_corners(geometry))
        share = float(geometry.boundary_height(middle)[0])
        parts = [share, length - share]
    counts = [max(1, round(part / (LAYER * size))) for part in parts] if layers is None else layers
    below, above = (*counts, 0)[:2]
    if below < 1 or (above < 1 if len(parts) == 2 else above != 0):
        expected = "2 grains; (1, 1) or more" if len(parts) == 2 else "one grain; (1 or more, 0)"
        raise ValueError(f"layers are {layers} in a prism of {expected} are expected")
    if section.bottom:
        swept = swept_quadrilateral(*section.quadrilaterals(divisions), below + above)
    else:
        swept = swept_triangle(divisions, below + above)
    shares, layer, cells, faces = swept
    points = np.zeros((len(shares), 3))
    points[:, [0, 2]] = shares @ corners
    height = geometry.boundary_height(points) if above else np.full(len(points), length)
    points[:, 1] = np.where(
        layer <= below,
        height * layer / below,
        height + (length - height) * (layer - below) / max(1, above),
    )
    points[layer == below + above, 1] = length
    grain = (layer[cells].mean(axis=1) > below).astype(np.int64)
    return PrismMesh(points, cells, grain, faces, node_groups(points, faces))


def _corners(geometry: PrismGeometry) -> FloatArray:
    """Return the corners of the prism [µm], those at Y = 0 first, shape (6 or 8, 3)."""
    x, z = geometry.section.corners.T
    ends = [np.column_stack([x, np.full(x.size, y), z]) for y in (0.0, geometry.length)]
    return np.concatenate(ends)


def _require_two_grains(geometry: PrismGeometry) -> None:
    distance = geometry.boundary_distance(_corners(geometry))
    tolerance = 1e-6 * geometry.length
    if distance.min() > -tolerance or distance.max() < tolerance:
        empty = 1 if distance.min() > -tolerance else 2
        raise ValueError(
            f"the grain boundary through {geometry.boundary_point} with normal "
            f"{geometry.boundary_normal} does not cut the prism: grain {empty} is empty"
        )


def _tet10_by_gmsh(geometry: PrismGeometry, size: float) -> tuple[FloatArray, IntArray]:
    """Points (n, 3) and tet10 cells (m, 10) in VTK order."""
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
            _build(gmsh, geometry)
            gmsh.model.mesh.generate(3)
            return _tet10(gmsh)
        except Exception as error:  # gmsh raises bare Exception
            raise RuntimeError(f"gmsh could not mesh the prism: {error}") from error


def _build(gmsh: ModuleType, geometry: PrismGeometry) -> None:
    occ = gmsh.model.occ
    corners = _corners(geometry)
    section = _polygon(occ, corners[: len(corners) // 2])
    extruded = occ.extrude([(2, section)], 0, geometry.length, 0)
    prism = [entity for entity in extruded if entity[0] == 3]
    if geometry.boundary_point is not None:
        cut = _polygon(occ, _boundary_square(geometry))
        occ.fragment(prism, [(2, cut)])
    occ.synchronize()
    # What sticks out of the prism is no part of the mesh.
    inside = gmsh.model.getBoundary(gmsh.model.getEntities(3), combined=False, oriented=False)
    gmsh.model.removeEntities(
        [face for face in gmsh.model.getEntities(2) if face not in inside], recursive=True
    )


def _polygon(occ: Any, corners: FloatArray) -> int:
    points = [occ.addPoint(*corner) for corner in corners]
    lines = [occ.addLine(a, b) for a, b in zip(points, points[1:] + points[:1], strict=True)]
    surface: int = occ.addPlaneSurface([occ.addCurveLoop(lines)])
    return surface


def _boundary_square(geometry: PrismGeometry) -> FloatArray:
    """Corners of a square in the boundary plane that covers the whole prism, shape (4, 3)."""
    corners = _corners(geometry)
    centre = corners.mean(axis=0)
    normal = np.asarray(geometry.boundary_normal, dtype=float)
    normal = normal / np.linalg.norm(normal)
    origin = centre - geometry.boundary_distance(centre) * normal
    first = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    first /= np.linalg.norm(first)
    second = np.cross(normal, first)
    reach = 2 * float(np.linalg.norm(corners - centre, axis=1).max())
    signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    square: FloatArray = origin + reach * (signs @ np.array([first, second]))
    return square


def _tet10(gmsh: ModuleType) -> tuple[FloatArray, IntArray]:
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    _, connectivity = gmsh.model.mesh.getElementsByType(_GMSH_TET10)
    used, cells = np.unique(np.asarray(connectivity, dtype=np.int64), return_inverse=True)
    order = np.argsort(tags)
    rows = order[np.searchsorted(np.asarray(tags)[order], used)]
    points = np.asarray(coordinates, dtype=np.float64).reshape(-1, 3)[rows]
    return points, cells.reshape(-1, 10)[:, _GMSH_TO_VTK]


def _faces(geometry: PrismGeometry, points: FloatArray, cells: IntArray) -> dict[str, IntArray]:
    """Return named faces; their nodes, off by gmsh's round-off, are put exactly on the planes."""
    outer, _ = outer_faces(cells)
    planes = {"S_PLUS": (1, geometry.length), "S_MINUS": (1, 0.0), "TOP": (2, 0.0)}
    faces = {}
    for name, (axis, value) in planes.items():
        on_plane = np.abs(points[:, axis] - value) < 1e-8 * geometry.length
        points[on_plane, axis] = value
        faces[name] = outer[on_plane[outer].all(axis=1)]
    return faces
