"""Grains of a face that lie as in an EBSD map: placed by a point and the frame, or refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from driver.case.grains import EULER_AXES, OF_THE_FACE
from driver.case.model import Case, case_text, load_case
from driver.common.errors import InputError
from driver.experiment.labels import columns_of_case
from driver.experiment.map_labels import labels_of_map, map_on_face, share_without_grain
from driver.experiment.orientations import orientations_of
from driver.forward.build import mesh_of
from driver.results.mesh_sizes import sized
from driver.workflow.engine import stage_inputs
from driver.workflow.pipeline import stages
from meshes.arrays import FloatArray, IntArray
from solver_adapters.bundled.adapter import BundledAdapter
from solver_adapters.crystal import bunge_matrix
from tests.driver.ebsd_files import (
    FIRST,
    IRON,
    SECOND,
    TITANIUM,
    grid,
    hexagonal_grid,
    write_ang,
)
from tools.three_grains import tables

WIDTH, LENGTH, STEP = 4.0, 12.0, 0.25
ORIGIN = (2.0, 3.0)  # of the specimen in the map, x along Y and y along X
THIRD = (40.0, 30.0, 20.0)
ANGLES = np.array([FIRST, SECOND, THIRD])
PLACES = ((4.0, 3.0), (8.0, 1.8), (8.0, 4.2))
"""A point of each grain in the map."""


def number_at(x: FloatArray, y: FloatArray) -> IntArray:
    """The grain at places X, Y of the face: one, and two beside each other after it."""
    return np.where(y < 5.0 + 0.3 * x, 1, np.where(x < 0.0, 2, 3))


def write_map(path: Path, hexagonal: bool = False, unknown: bool = False) -> Path:
    rows = round((WIDTH + 2.0) / STEP / (3**0.5 / 2 if hexagonal else 1.0))
    points = (hexagonal_grid if hexagonal else grid)(rows, round(15.0 / STEP), STEP)
    numbers = number_at(points[1] - ORIGIN[1], points[0] - ORIGIN[0])
    confidence = np.full(points[0].size, 0.9)
    if unknown:  # as many points are along a boundary
        along = (numbers > 1) & (np.abs(points[1] - ORIGIN[1]) < 0.6 * STEP)
        confidence[along] = -1
    return write_ang(path, *points, ANGLES[numbers - 1], confidence=confidence, hexagonal=hexagonal)


def case_in(folder: Path, n_grains: int = 3, **changed: Any) -> Case:
    """A bar whose grains are those of a map in its folder."""
    data = tables()
    data["grains"] = [
        {"name": f"grain {k + 1}", "ebsd": "map.ang", "ebsd_point_um": PLACES[k]}
        for k in range(n_grains)
    ]
    data["orientation"] = {"ebsd_frame": "edax", "ebsd_to_specimen": OF_THE_FACE}
    data["material"]["strain_measure"] = "small"
    data["specimen"] |= {
        "boundaries": (), "cells": None, "labels": "map.ang", "labels_point_um": ORIGIN,
        "mesh_size_um": "auto", "fine_mesh_size_um": "auto", "depth_um": 3.0,
        "width_um": WIDTH, "length_um": LENGTH,
    }  # fmt: skip
    for key, value in changed.items():
        table, name = key.split("__")
        data[table][name] = value
    case = Case.model_validate(data, context={"file": folder / "case.toml"})
    return sized(case, BundledAdapter().capabilities())


def picked_at(case: Case, number: int, point: tuple[float, float]) -> Case:
    """The case with another point for a grain."""
    grains = list(case.grains)
    grains[number - 1] = grains[number - 1].model_copy(update={"ebsd_point_um": point})
    return case.model_copy(update={"grains": tuple(grains)})


def middles(labels: IntArray) -> tuple[FloatArray, FloatArray]:
    x, y = ((np.arange(n) + 0.5) / n for n in labels.shape)
    return WIDTH * (x[:, None] - 0.5), LENGTH * y[None]


@pytest.mark.parametrize("hexagonal", [False, True])
def test_each_square_of_the_face_has_the_grain_that_the_map_shows_there(
    tmp_path: Path, hexagonal: bool
) -> None:
    write_map(tmp_path / "map.ang", hexagonal)
    labels = labels_of_map(map_on_face(case_in(tmp_path)))
    x, y = middles(labels)
    # Within a step of a boundary the nearest point may be one of the other side.
    clear = (np.abs(y - 5.0 - 0.3 * x) > STEP) & ((y < 5.0 + 0.3 * x) | (np.abs(x) > STEP))
    np.testing.assert_array_equal(labels[clear], number_at(x, y)[clear])
    assert clear.mean() > 0.85


def test_a_map_that_lies_turned_shows_the_same_grains(tmp_path: Path) -> None:
    """By half a turn about the normal of the face, with the place of the origin turned as well."""
    write_map(tmp_path / "map.ang")
    as_it_is = labels_of_map(map_on_face(case_in(tmp_path)))
    turned = ((0.0, -1.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 0.0, -1.0))
    opposite = (ORIGIN[0] + LENGTH, ORIGIN[1])
    case = case_in(
        tmp_path, orientation__ebsd_to_specimen=turned, specimen__labels_point_um=opposite
    )
    np.testing.assert_array_equal(labels_of_map(map_on_face(case)), as_it_is[::-1, ::-1])


def test_the_face_lies_in_the_map_where_its_origin_and_its_axes_say(tmp_path: Path) -> None:
    """x of the map along Y from 2 to 14 µm, y along X from 1 to 5 µm."""
    write_map(tmp_path / "map.ang")
    corners = map_on_face(case_in(tmp_path)).corners
    np.testing.assert_allclose(corners, [[2, 1], [2, 5], [14, 5], [14, 1]], atol=1e-12)


def test_columns_have_the_areas_and_the_orientations_of_the_map(tmp_path: Path) -> None:
    """Points that were not indexed go to the grain that lies nearest."""
    write_map(tmp_path / "map.ang", unknown=True)
    case = case_in(tmp_path)
    assert share_without_grain(map_on_face(case)) > 0.02
    columns = columns_of_case(case)
    assert columns is not None and columns_of_case(case) is columns
    mesh = mesh_of(case, 2.0)
    volumes = np.bincount(mesh.grain, weights=volumes_of(mesh.points, mesh.cells))
    x, y = middles(np.zeros((400, 1200), dtype=np.int64))
    shares = np.bincount(number_at(x, y).ravel())[1:] / x.size / y.size
    np.testing.assert_allclose(volumes / volumes.sum(), shares, atol=0.02)
    assert mesh.n_grains == 3
    frame = np.array(OF_THE_FACE) @ np.array(EULER_AXES["edax"])
    for found, angles in zip(orientations_of(case), ANGLES, strict=True):
        np.testing.assert_allclose(found, frame @ bunge_matrix(*angles), atol=1e-4)


def volumes_of(points: FloatArray, cells: IntArray) -> FloatArray:
    corners = points[cells[:, :4]]
    return np.asarray(np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])) / 6)


def keys_of(case: Case) -> list[dict[str, str]]:
    """What mesh and measurement of a case depend on."""
    return [stage_inputs(stage, case) for stage in stages(case)[:2]]


@pytest.mark.parametrize(
    "changed",
    [
        {"specimen.labels_point_um": (2.25, 3.0)},
        {"orientation.ebsd_to_specimen":
            ((0.02, 0.9998, 0.0), (0.9998, -0.02, 0.0), (0.0, 0.0, -1.0))},
    ],
)  # fmt: skip
def test_mesh_and_measurement_hang_on_where_the_map_lies(
    tmp_path: Path, changed: dict[str, Any]
) -> None:
    write_map(tmp_path / "map.ang")
    case = case_in(tmp_path)
    for one, other in zip(keys_of(case), keys_of(case.with_values_at(changed)), strict=True):
        assert one != other


def test_mesh_and_measurement_hang_on_the_map_and_on_the_picks(tmp_path: Path) -> None:
    write_map(tmp_path / "map.ang")
    case = case_in(tmp_path)
    before = keys_of(case)
    moved = keys_of(picked_at(case, 2, (8.0, 2.0)))
    write_map(tmp_path / "map.ang", unknown=True)
    after = keys_of(case)
    for one, two, three in zip(before, moved, after, strict=True):
        assert one != two and one != three


def test_another_frame_of_the_angles_moves_no_grain(tmp_path: Path) -> None:
    write_map(tmp_path / "map.ang")
    case = case_in(tmp_path)
    assert keys_of(case) == keys_of(case.with_values_at({"orientation.ebsd_frame": "oxford"}))


def test_a_written_case_reads_back_as_it_was(tmp_path: Path) -> None:
    case = case_in(tmp_path)
    (tmp_path / "case.toml").write_text(case_text(case), encoding="utf-8")
    assert load_case(tmp_path / "case.toml").model_dump() == case.model_dump()


@pytest.mark.parametrize(
    ("n_grains", "changed", "told"),
    [
        (2, {}, "found a grain that no table [[grains]] picks on 0.28 of the face, around "
         "[10.75, 3.75], expected a table for each grain of the face; parts of one grain that "
         "points without an index separate are joined by the EBSD software"),
        (3, {"specimen__labels_point_um": (5.0, 3.0)}, "found a face from [5, 1] to [17, 5] of the "
         "map by labels_point_um and orientation.ebsd_to_specimen, expected one within its points, "
         "[0, 0] to [14.75, 5.75]"),
        (3, {"orientation__ebsd_to_specimen": ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0))},
         "found a map whose z is 90° off −Z of the specimen by ebsd_to_specimen, expected a map of "
         "the face, to 5°"),
        (3, {"orientation__ebsd_to_specimen": ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))},
         "found a map whose z is 180° off −Z of the specimen by ebsd_to_specimen, expected a map "
         "of the face, to 5°"),
        (3, {"specimen__width_um": 0.8}, "found steps of 0.25 µm, expected at most 0.2 µm"),
    ],
)  # fmt: skip
def test_a_map_that_does_not_show_the_grains_of_the_case_is_refused_in_one_sentence(
    tmp_path: Path, n_grains: int, changed: dict[str, Any], told: str
) -> None:
    write_map(tmp_path / "map.ang")
    with pytest.raises(InputError) as error:
        labels_of_map(map_on_face(case_in(tmp_path, n_grains, **changed)))
    assert str(error.value) == f"{tmp_path / 'map.ang'}: specimen.labels: {told}"


def test_a_phase_that_is_not_cubic_is_refused_and_not_given_to_its_neighbours(
    tmp_path: Path,
) -> None:
    x, y = grid(24, 60, STEP)
    numbers = number_at(y - ORIGIN[1], x - ORIGIN[0])
    phases = np.where((x > 10.0) & (y > 2.0) & (y < 4.0), 2, 1)
    write_ang(tmp_path / "map.ang", x, y, ANGLES[numbers - 1], phases, phases=(IRON, TITANIUM))
    with pytest.raises(InputError, match=r"a phase that is not cubic on 0.1\d of the face, around"):
        labels_of_map(map_on_face(case_in(tmp_path)))


def test_a_gap_in_the_map_has_no_grain(tmp_path: Path) -> None:
    """Three rows of the map without points, between grains 2 and 3."""
    x, y = grid(24, 60, STEP)
    numbers = number_at(y - ORIGIN[1], x - ORIGIN[0])
    there = (numbers == 1) | (np.abs(y - ORIGIN[1]) > 1.1 * STEP)
    count = {"NCOLS_ODD": str(there.sum()), "NCOLS_EVEN": str(there.sum()), "NROWS": "1"}
    angles = ANGLES[numbers[there] - 1]
    write_ang(tmp_path / "map.ang", x[there], y[there], angles, header=count)
    labels = labels_of_map(map_on_face(case_in(tmp_path)))
    rows = (labels[:, -1] == 0).sum()
    assert 1 <= rows <= 3 and set(np.unique(labels)) == {0, 1, 2, 3}


def test_two_tables_of_one_grain_are_refused(tmp_path: Path) -> None:
    write_map(tmp_path / "map.ang")
    case = picked_at(case_in(tmp_path), 3, (9.0, 1.8))
    with pytest.raises(InputError, match="found the same grain for the tables 2 and 3 of"):
        labels_of_map(map_on_face(case))


def test_a_map_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="map.ang: grains.1.ebsd: found nothing, expected"):
        labels_of_map(map_on_face(case_in(tmp_path)))


@pytest.mark.parametrize(
    ("changed", "key", "expected"),
    [
        ({"specimen__labels_point_um": None}, "specimen.labels_point_um",
         "a list of two numbers [x, y], where the map of specimen.labels has the middle of the "
         "edge Y = 0 of the face"),
        ({"specimen__labels_pixel_nm": 50.0}, "specimen.labels_pixel_nm",
         "nothing: the map has its step"),
        ({"orientation__ebsd_frame": None}, "orientation.ebsd_frame",
         '"edax", "oxford" or "bruker", so that ebsd_to_specimen is how the map of '
         "specimen.labels lies; angles of another setting take a label image"),
        ({"specimen__labels": "other.ang"}, "specimen.labels",
         "an image, or the EBSD map that all tables [[grains]] name in ebsd"),
        ({"specimen__labels": None}, "labels_point_um", "nothing, or labels as well"),
    ],
)  # fmt: skip
def test_a_case_that_lacks_what_places_a_map_is_refused(
    tmp_path: Path, changed: dict[str, Any], key: str, expected: str
) -> None:
    with pytest.raises(ValueError) as error:
        case_in(tmp_path, **changed)
    details = error.value.errors()[0]["ctx"]  # type: ignore[attr-defined]
    assert (details["key"], details["expected"]) == (key, expected)


def test_a_grain_with_stated_angles_among_those_of_a_map_is_refused(tmp_path: Path) -> None:
    data = case_in(tmp_path).model_dump(mode="json")
    data["grains"][1] = {"name": "grain 2", "euler_deg": SECOND}
    with pytest.raises(ValueError) as error:
        Case.model_validate(data, context={"file": tmp_path / "case.toml"})
    details = error.value.errors()[0]["ctx"]  # type: ignore[attr-defined]
    assert details["key"] == "grains.2.ebsd" and '"map.ang" as specimen.labels' in str(details)
