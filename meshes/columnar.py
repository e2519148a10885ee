"""Grains as columns below the measured face: their lines on it, and conforming tetrahedra."""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType

import numpy as np
from scipy.ndimage import distance_transform_edt

from meshes.arrays import FloatArray, IntArray
from meshes.cells import inverted_cells
from meshes.label_lines import lines_between, without_specks
from meshes.prism import (
    PrismGeometry,
    keep_solids,
    named_faces,
    refuse_too_many,
    solid_of,
    tetrahedra,
)
from meshes.prism_mesh import PrismMesh
from meshes.tet10 import node_groups

LEAST_REGION = 0.01
"""Area of a region that is kept, over the square of the width of the face."""
_OFF = 0.02  # of the width, by which a line may be off the smoothed one
_BEYOND = 0.1  # of the width, by which the sides of columns stand out of the specimen
_AT_RIM = 1e-9  # of the width, between the rim of the face and a line that ends there


@dataclass(frozen=True, eq=False)
class Columns:
    """Grains as columns along Z.

    Attributes:
        grain: of each square of the face, from 0, rows along X, columns along Y.
        lines: points (X, Y) of each line between two of them [µm], shapes (n, 2).
    """

    grain: IntArray
    lines: tuple[FloatArray, ...]

    def at(self, xy: FloatArray, width: float, length: float) -> IntArray:
        """Return the grain of the square that holds each point, or is nearest, shape (n,)."""
        shares = (xy + np.array([width / 2, 0.0])) / np.array([width, length])
        last = np.array(self.grain.shape) - 1
        rows, columns = np.clip((shares * self.grain.shape).astype(int), 0, last).T
        found: IntArray = self.grain[rows, columns]
        return found

    def middles(self, width: float, length: float) -> list[tuple[int, FloatArray]]:
        """Return the grains with the place X, Y of each that lies deepest inside it [µm]."""
        found = []
        for grain in np.unique(self.grain):
            depth = distance_transform_edt(np.pad(self.grain == grain, 1))[1:-1, 1:-1]
            at = np.array(np.unravel_index(np.argmax(depth), depth.shape)) + 0.5
            place = at / self.grain.shape * np.array([width, length])
            found.append((int(grain), place - np.array([width / 2, 0.0])))
        return found


def columns_of(grain: IntArray, width: float, length: float) -> Columns:
    """Return the columns of grains whose squares tile the face.

    Args:
        grain: of each square, from 0, −1 of none, shape (n_x, n_y).
        width: of the face along X [µm].
        length: of the face along Y [µm].

    Raises:
        ValueError: no region is large enough, or a grain has none.
    """
    square = width / grain.shape[0], length / grain.shape[1]
    n_grains = int(grain.max()) + 1
    kept = without_specks(grain, LEAST_REGION * width**2 / (square[0] * square[1]))
    lost = np.setdiff1d(np.arange(n_grains), kept)
    if len(lost):
        raise ValueError(
            f"found no region of grain {lost[0] + 1} with {LEAST_REGION * width**2:.2g} µm² or "
            "more on the face, expected one of every grain"
        )
    shift = np.array([-width / 2, 0.0])
    return Columns(kept, tuple(line + shift for line in lines_between(kept, square, _OFF * width)))


def generate_columns(geometry: PrismGeometry, columns: Columns, size: float) -> PrismMesh:
    """Mesh a specimen with grains as columns by tetrahedra that conform to them.

    Args:
        geometry: the specimen, without grain boundaries.
        columns: its grains.
        size: edge of the cells [µm].

    Returns:
        the mesh, every Jacobian positive.

    Raises:
        ValueError: the size makes too many cells.
        RuntimeError: gmsh could not mesh the specimen.
    """
    refuse_too_many(geometry, size, "tet10")

    def build(gmsh: ModuleType) -> None:
        solid = solid_of(gmsh, geometry)
        sides = _sides(gmsh, geometry, columns.lines)
        if sides:
            gmsh.model.occ.fragment(solid, sides)
        keep_solids(gmsh)

    points, cells, solid = tetrahedra(build, size)
    if len(inverted_cells(points, cells)):
        raise RuntimeError(
            f"gmsh made inverted cells with element size {size} µm; another size is needed"
        )
    corners = points[cells[:, :4]]
    volume = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1]))
    here = columns.at(corners.mean(axis=1)[:, :2], geometry.width, geometry.length)
    grain = np.zeros(len(cells), dtype=np.int64)
    for one in np.unique(solid):
        # A line leaves the squares a little: of a column most is in one grain.
        own = solid == one
        grain[own] = np.argmax(np.bincount(here[own], weights=volume[own]))
    faces = named_faces(geometry, points, cells)
    return PrismMesh(points, cells, grain, faces, node_groups(points, faces))


def _sides(
    gmsh: ModuleType, geometry: PrismGeometry, lines: tuple[FloatArray, ...]
) -> list[tuple[int, int]]:
    """Surfaces below the lines, which stand out of the specimen all round."""
    occ, out = gmsh.model.occ, _BEYOND * geometry.width
    places: dict[tuple[float, float], int] = {}
    wires = []
    for line in lines:
        points = []
        for at in _beyond(line, geometry, out):
            key = (round(float(at[0]), 9), round(float(at[1]), 9))
            if key not in places:
                places[key] = occ.addPoint(*key, out)
            points.append(places[key])
        wires += [(1, occ.addLine(a, b)) for a, b in zip(points, points[1:], strict=False)]
    if not wires:
        return []
    swept = occ.extrude(wires, 0, 0, -geometry.depth - 2 * out)
    return [entity for entity in swept if entity[0] == 2]


def _beyond(line: FloatArray, geometry: PrismGeometry, out: float) -> FloatArray:
    """Return a line that goes on over the rim of the face where it ends there."""
    half, near = geometry.width / 2, _AT_RIM * geometry.width
    wide = max(0.0, geometry.bottom / 2 - half) + out
    before: list[FloatArray] = []
    after: list[FloatArray] = []
    for end, beyond in ((line[0], before), (line[-1], after)):
        if half - abs(end[0]) < near:
            beyond.append(end + np.array([np.sign(end[0]) * wide, 0.0]))
        elif end[1] < near or geometry.length - end[1] < near:
            beyond.append(end + np.array([0.0, -out if end[1] < near else out]))
    return np.concatenate([np.reshape(before, (-1, 2)), line, np.reshape(after, (-1, 2))])
