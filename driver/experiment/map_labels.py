"""The grains of a face as an EBSD map of it shows them."""

from __future__ import annotations

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
from driver.experiment.orientations import Stamp, picks_of, stamp_of
from meshes.arrays import FloatArray, IntArray
from meshes.columnar import LEAST_REGION

_KEY = "specimen.labels"
_STEEPEST = 5.0  # degrees between the normals of map and face
_BEYOND = 1.0  # step, by which the rim of the face may lie out of the map


def labels_of_map(case: Case) -> IntArray:
    """Return the number of the grain of each square of the face, from 1, and 0 of none.

    A square is as large as a step of the map and has the grain of the nearest point.

    Args:
        case: a case whose `specimen.labels` is the map in which all its grains are picked.

    Returns:
        Rows along X, columns along Y, shape (n_x, n_y).

    Raises:
        InputError: the map cannot be used, is none of the face, does not cover it, or shows a
            grain on it that has no table.
    """
    specimen = case.specimen
    assert specimen.labels is not None and specimen.labels_point_um is not None
    file, rotation = case.path(specimen.labels), case.orientation.rotation
    turned = np.rad2deg(np.arccos(min(abs(rotation[2, 2]), 1.0)))
    if turned > _STEEPEST:
        found = f"a map whose normal is {turned:.3g}° off that of the face by ebsd_to_specimen"
        raise InputError(sentence(file, _KEY, found, f"one of the face, to {_STEEPEST:g}°"))
    picks = tuple(picks_of(case, file).values())
    in_plane = tuple(float(value) for value in rotation[:2, :2].ravel())
    try:
        return _labels(
            file, stamp_of(file), picks, in_plane, specimen.labels_point_um,
            (specimen.width, specimen.length),
        )  # fmt: skip
    except Refused as refused:
        raise InputError(sentence(file, _KEY, refused.found, refused.expected)) from None


def face_on_map(case: Case) -> FloatArray:
    """Return the corners of the face in the map that `specimen.labels` names, x and y [µm], (4, 2).

    Args:
        case: a case whose `specimen.labels` is a map.
    """
    specimen = case.specimen
    assert specimen.labels_point_um is not None
    half, length = specimen.width / 2, specimen.length
    corners = np.array([[-half, 0.0], [half, 0.0], [half, length], [-half, length]])
    return _on_map(specimen.labels_point_um, corners, case.orientation.rotation[:2, :2])


def _on_map(origin: tuple[float, float], places: FloatArray, in_plane: FloatArray) -> FloatArray:
    """Return places X, Y of the face in the map: the transpose leads back to it."""
    return np.array(origin) + places @ in_plane


@lru_cache(maxsize=2)
def _labels(
    file: Path,
    stamp: Stamp,
    picks: tuple[Pick, ...],
    in_plane: tuple[float, ...],
    origin: tuple[float, float],
    face: tuple[float, float],
) -> IntArray:
    points = read_map(file)
    numbers = grain_numbers(points)
    of_point = _numbered(points, numbers, picks)
    steps = grid_steps(points)
    step, (width, length) = min(steps), face
    squares = max(1, round(width / step)), max(1, round(length / step))
    x = (np.arange(squares[0]) + 0.5) * width / squares[0] - width / 2
    y = (np.arange(squares[1]) + 0.5) * length / squares[1]
    there = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    on_map = _on_map(origin, there, np.reshape(in_plane, (2, 2)))
    away, nearest = cKDTree(np.column_stack([points.x, points.y])).query(on_map)
    _refuse_what_is_beyond(points, on_map, away > (0.5 * 2**0.5 + _BEYOND) * max(steps))
    _refuse_grains_without_a_table(points, numbers, of_point, nearest, face)
    return np.reshape(of_point[nearest], squares)


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


def _refuse_what_is_beyond(points: EbsdMap, on_map: FloatArray, beyond: FloatArray) -> None:
    if not beyond.any():
        return
    (left, top), (right, bottom) = on_map.min(axis=0), on_map.max(axis=0)
    x, y = points.x, points.y
    raise Refused(
        f"a face from [{left:.4g}, {top:.4g}] to [{right:.4g}, {bottom:.4g}] of the map by "
        "labels_point_um and orientation.ebsd_to_specimen",
        f"one within its points, [{x.min():.4g}, {y.min():.4g}] to [{x.max():.4g}, {y.max():.4g}]",
    )


def _refuse_grains_without_a_table(
    points: EbsdMap,
    numbers: IntArray,
    of_point: IntArray,
    nearest: IntArray,
    face: tuple[float, float],
) -> None:
    """Refuse a face with a grain that is large enough to be meshed and that no table picks."""
    without = nearest[(of_point[nearest] == 0) & (numbers[nearest] >= 0)]
    if not without.size:
        return
    sizes = np.bincount(numbers[without])
    largest = int(np.argmax(sizes))
    width, length = face
    share = sizes[largest] / nearest.size
    if share * length < LEAST_REGION * width:
        return
    members = without[numbers[without] == largest]
    off = [at[members] - np.median(at[members]) for at in (points.x, points.y)]
    inside = members[int(np.argmin(off[0] ** 2 + off[1] ** 2))]
    raise Refused(
        f"a grain on {share:.2g} of the face, around [{points.x[inside]:g}, {points.y[inside]:g}], "
        "that no table [[grains]] picks",
        "a table for each grain of the face",
    )
