"""The grains of a face as an EBSD map of it shows them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from driver.case.model import Case
from driver.common.errors import InputError, sentence
from driver.experiment.ebsd.maps import EbsdMap, read_map
from driver.experiment.ebsd.picking import Pick, members_of
from driver.experiment.ebsd.segmentation import grain_numbers, grid_steps
from driver.experiment.images.files import Refused
from driver.experiment.orientations import Stamp, grain_orientations, picks_of, stamp_of
from meshes.arrays import BoolArray, FloatArray, IntArray
from meshes.columnar import LEAST_REGION

_KEY = "specimen.labels"
_STEEPEST = 5.0  # degrees between the normals of map and face
_COARSEST = 0.25  # step over the width of the face
_REACH = 0.75  # of a step, within which a place has the grain of a point
_RIM = 0.02  # of the width, by which the face may lie out of the cells of the map


@dataclass(frozen=True)
class MapOnFace:
    """How an EBSD map lies on the measured face.

    Attributes:
        file: the map.
        stamp: what tells it from the file that was there before.
        picks: what picks each grain, in the order of the tables.
        in_plane: from x and y of the map to X and Y of the specimen, the four entries row by row.
        origin: x and y of the map where X = Y = 0 [µm].
        width: of the face along X [µm].
        length: of the face along Y [µm].
    """

    file: Path
    stamp: Stamp
    picks: tuple[Pick, ...]
    in_plane: tuple[float, ...]
    origin: tuple[float, float]
    width: float
    length: float

    @property
    def corners(self) -> FloatArray:
        """Corners of the face in the map, x and y [µm], shape (4, 2)."""
        x, y = 0.5 * self.width, self.length
        return self.in_map(np.array([[-x, 0.0], [x, 0.0], [x, y], [-x, y]]))

    def in_map(self, places: FloatArray) -> FloatArray:
        """Return places X, Y of the face [µm] in the map, shape (n, 2)."""
        # The inverse of a rotation is its transpose.
        turned: FloatArray = places @ np.reshape(self.in_plane, (2, 2))
        return np.array(self.origin) + turned


def map_on_face(case: Case) -> MapOnFace:
    """Return how the map of a case lies on the face.

    Args:
        case: a case whose `specimen.labels` is the map in which all its grains are picked.

    Raises:
        InputError: there is no such map, a pick meets no grain of it, or it is none of the face.
    """
    specimen = case.specimen
    assert specimen.labels is not None and specimen.labels_point_um is not None
    grain_orientations(case)  # tells what is wrong with the map or a pick by the key of its grain
    file, rotation = case.path(specimen.labels), case.orientation.rotation
    # z of a map points into the surface.
    turned = np.rad2deg(np.arccos(np.clip(-rotation[2, 2], -1.0, 1.0)))
    if turned > _STEEPEST:
        found = f"a map whose z is {turned:.3g}° off −Z of the specimen by ebsd_to_specimen"
        raise InputError(sentence(file, _KEY, found, f"a map of the face, to {_STEEPEST:g}°"))
    return MapOnFace(
        file=file,
        stamp=stamp_of(file),
        picks=tuple(picks_of(case, file).values()),
        in_plane=tuple(float(value) for value in rotation[:2, :2].ravel()),
        origin=specimen.labels_point_um,
        width=specimen.width,
        length=specimen.length,
    )


@lru_cache(maxsize=2)
def labels_of_map(on_face: MapOnFace) -> IntArray:
    """Return the number of the grain of each square of the face, from 1, and 0 of none.

    A square is as large as a step of the map and has the grain of the nearest point.

    Args:
        on_face: how the map lies on the face.

    Returns:
        Rows along X, columns along Y, shape (n_x, n_y), not to be written.

    Raises:
        InputError: the map is too coarse, does not cover the face, or shows a grain on it that
            has no table.
    """
    try:
        labels = _labels(on_face)
    except Refused as refused:
        raise InputError(sentence(on_face.file, _KEY, refused.found, refused.expected)) from None
    labels.setflags(write=False)
    return labels


def _labels(on_face: MapOnFace) -> IntArray:
    points = read_map(on_face.file)
    numbers = grain_numbers(points)
    of_point = _numbered(points, numbers, on_face.picks)
    steps, width, length = grid_steps(points), on_face.width, on_face.length
    if max(steps) > _COARSEST * width:
        raise Refused(f"steps of {max(steps):g} µm", f"at most {_COARSEST * width:g} µm")
    _refuse_what_is_beyond(points, steps, on_face)
    squares = round(width / min(steps)), round(length / min(steps))
    x = (np.arange(squares[0]) + 0.5) * width / squares[0] - width / 2
    y = (np.arange(squares[1]) + 0.5) * length / squares[1]
    there = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    places = cKDTree(np.column_stack([points.x, points.y]))
    away, nearest = places.query(on_face.in_map(there))
    met = away <= _REACH * max(steps)
    _refuse_grains_without_a_table(points, numbers, of_point, nearest[met], on_face)
    return np.reshape(np.where(met, of_point[nearest], 0), squares)


def _numbered(points: EbsdMap, numbers: IntArray, picks: tuple[Pick, ...]) -> IntArray:
    """Return the number of the table of each point of the map, 0 of none, shape (n,)."""
    of_point = np.zeros(points.x.size, dtype=np.int64)
    for number, pick in enumerate(picks, start=1):
        members = members_of(points, numbers, pick)[1]
        other = int(of_point[members].max())
        if other:
            raise Refused(
                f"the same grain for the tables {other} and {number} of [[grains]]",
                "another one for each",
            )
        of_point[members] = number
    return of_point


def _refuse_what_is_beyond(points: EbsdMap, steps: tuple[float, float], on_face: MapOnFace) -> None:
    rim = 0.5 * np.array(steps) + _RIM * on_face.width
    places = np.column_stack([points.x, points.y])
    least, most = places.min(axis=0), places.max(axis=0)
    corners = on_face.corners
    first, last = corners.min(axis=0), corners.max(axis=0)
    if (first >= least - rim).all() and (last <= most + rim).all():
        return
    raise Refused(
        f"a face from {_told(first)} to {_told(last)} of the map by labels_point_um and "
        "orientation.ebsd_to_specimen",
        f"one within its points, {_told(least)} to {_told(most)}",
    )


def _told(place: FloatArray) -> str:
    return f"[{place[0]:.4g}, {place[1]:.4g}]"


def _refuse_grains_without_a_table(
    points: EbsdMap,
    numbers: IntArray,
    of_point: IntArray,
    nearest: IntArray,
    on_face: MapOnFace,
) -> None:
    """Refuse a face with a grain that is large enough to be meshed and that no table picks."""
    other_phase = points.indexed & ~points.cubic
    without = nearest[of_point[nearest] == 0]
    cubic = without[numbers[without] >= 0]
    by_size = np.bincount(numbers[cubic], minlength=1)
    for members, what, expected in (
        (
            cubic[numbers[cubic] == np.argmax(by_size)],
            "a grain that no table [[grains]] picks",
            "a table for each grain of the face; parts of one grain that points without an index "
            "separate are joined by the EBSD software",
        ),
        (
            without[other_phase[without]],
            "a phase that is not cubic",
            "cubic grains alone, which the law describes",
        ),
    ):
        share = members.size / nearest.size
        if share * on_face.length < LEAST_REGION * on_face.width:
            continue
        off = [at[members] - np.median(at[members]) for at in (points.x, points.y)]
        inside = members[int(np.argmin(off[0] ** 2 + off[1] ** 2))]
        place = _told(np.array([points.x[inside], points.y[inside]]))
        raise Refused(f"{what} on {share:.2g} of the face, around {place}", expected)


def share_without_grain(on_face: MapOnFace) -> float:
    """Return the share of the face whose squares have no grain in the map.

    Raises:
        InputError: as of `labels_of_map`.
    """
    without: BoolArray = labels_of_map(on_face) == 0
    return float(without.mean())
