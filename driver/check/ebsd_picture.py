"""The EBSD maps of a case as pictures: crystals along the loading axis, and the picked grains."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Polygon
from matplotlib.patheffects import withStroke

from driver.case.model import Case
from driver.experiment.ebsd.maps import EbsdMap, read_map
from driver.experiment.ebsd.orix_library import compiled_apart
from driver.experiment.ebsd.segmentation import grid_steps
from driver.experiment.map_labels import map_on_face
from driver.experiment.orientations import grain_orientations, map_files
from driver.report.style import literal
from meshes.arrays import FloatArray

_MOST_CELLS = 600  # of a side, more than the picture has pixels
_NOT_INDEXED, _NOT_CUBIC = (0.0, 0.0, 0.0), (0.5, 0.5, 0.5)
_RIM = [withStroke(linewidth=3.5, foreground="black")]


@dataclass(frozen=True, eq=False)
class MapPicture:
    """A map to be drawn.

    Attributes:
        file: the map.
        colours: of its cells, rows along y, shape (rows, columns, 3).
        extent: left, right, bottom and top of the picture in the map [µm]; y grows downwards.
        picked: names of the picked grains, and where they lie [µm].
        face: corners of the measured face, x and y [µm], shape (4, 2); None where the map does not
            tell where the grains lie.
    """

    file: Path
    colours: FloatArray
    extent: tuple[float, float, float, float]
    picked: tuple[tuple[str, tuple[float, float]], ...]
    face: FloatArray | None = None


def map_pictures(case: Case) -> tuple[MapPicture, ...]:
    """Return what is drawn of each map of a case, whose orientations are known to be usable."""
    grains = list(zip(case.grains, grain_orientations(case), strict=True))
    loading_axis = case.orientation.from_euler_axes.T @ [0.0, 1.0, 0.0]
    pictures = []
    for file in map_files(case):
        points = read_map(file)
        picked = tuple(
            (grain.name, found.of_map.place)
            for grain, found in grains
            if grain.ebsd is not None and found.of_map and case.path(grain.ebsd) == file
        )
        face = map_on_face(case).corners if case.labelled_by_map else None
        pictures.append(MapPicture(file, *_cells(points, loading_axis), picked, face))
    return tuple(pictures)


def draw_map(axes: Axes, picture: MapPicture) -> None:
    """Draw a map, with the names of the grains where they were picked."""
    axes.imshow(picture.colours, extent=picture.extent, interpolation="nearest", aspect="equal")
    if picture.face is not None:
        axes.add_patch(
            Polygon(
                picture.face, fill=False, edgecolor="white", linewidth=1.8, linestyle="--",
                path_effects=_RIM, label="measured face",
            )
        )  # fmt: skip
        axes.legend(loc="lower right", fontsize=8)
    for name, (x, y) in picture.picked:
        axes.plot(x, y, "o", color="white", ms=7, mec="black")
        axes.annotate(
            literal(name), (x, y), xytext=(7, 7), textcoords="offset points", color="white",
            weight="bold", fontsize=11, path_effects=_RIM,
        )  # fmt: skip
    axes.set(
        xlabel="x of the map [µm]",
        ylabel="y of the map [µm]",
        title=f"{literal(picture.file.name)}: crystal along the loading axis\n"
        "red ⟨001⟩, green ⟨101⟩, blue ⟨111⟩, black not indexed",
    )


def _cells(
    points: EbsdMap, loading_axis: FloatArray
) -> tuple[FloatArray, tuple[float, float, float, float]]:
    """Colours of the cells of a map, and its extent; the first point of a cell stands for it."""
    dx, dy = grid_steps(points)
    left, top = float(points.x.min()), float(points.y.min())
    column = np.floor((points.x - left) / dx + 0.25).astype(np.int64)  # hexagonal: odd rows too
    row = np.rint((points.y - top) / dy).astype(np.int64)
    stride = ceil((max(int(column.max()), int(row.max())) + 1) / _MOST_CELLS)
    column, row = column // stride, row // stride
    colours = np.ones((int(row.max()) + 1, int(column.max()) + 1, 3))
    _, drawn = np.unique(row * colours.shape[1] + column, return_index=True)
    colours[row[drawn], column[drawn]] = np.where(
        points.indexed[drawn, None], _NOT_CUBIC, _NOT_INDEXED
    )
    shown = drawn[points.cubic[drawn]]
    colours[row[shown], column[shown]] = _ipf_colours(points.rotations[shown], loading_axis)
    right = left + dx * stride * colours.shape[1]
    bottom = top + dy * stride * colours.shape[0]
    return colours, (left - dx / 2, right - dx / 2, bottom - dy / 2, top - dy / 2)


def _ipf_colours(rotations: FloatArray, direction: FloatArray) -> FloatArray:
    """Colours of the crystal direction along a direction of the Euler axes, shape (n, 3)."""
    with compiled_apart():
        from orix.plot import IPFColorKeyTSL
        from orix.quaternion import Orientation
        from orix.quaternion.symmetry import Oh
        from orix.vector import Vector3d

    key = IPFColorKeyTSL(Oh, direction=Vector3d(direction))
    to_crystal = Orientation(rotations * [1.0, -1.0, -1.0, -1.0], symmetry=Oh)
    return np.asarray(key.orientation2color(to_crystal), dtype=np.float64)
