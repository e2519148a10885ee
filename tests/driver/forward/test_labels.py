"""Grains of a label image in a case: placed as the images, held against planes, refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from driver.case.model import Case, case_text, load_case
from driver.common.errors import InputError
from driver.diagnosis.causes.causes import LIBRARY
from driver.diagnosis.statistics.screening import screened
from driver.forward.build import adapter_of, build_model, mesh_of
from driver.forward.geometry import boundary_traces, grain_places
from driver.results.mesh_sizes import sized
from driver.virtual.truth import stage_program
from driver.workflow.engine import stage_inputs
from driver.workflow.pipeline import stages
from meshes.arrays import FloatArray, IntArray
from solver_adapters.bundled.adapter import BundledAdapter
from tools.three_grains import tables

ROWS, COLUMNS, PIXEL, ORIGIN = 60, 150, 0.1, (29.5, 14.5)
SLOPE = -0.2
PIXELS = np.stack(np.meshgrid([-1.5, 0.0, 1.5], [2.0, 6.0, 10.0]), axis=-1).reshape(-1, 2)
Labels = Callable[[FloatArray, FloatArray], IntArray]


def two(x: FloatArray, y: FloatArray) -> IntArray:
    """Two grains with a straight boundary."""
    return np.where(y > 6.0 + SLOPE * x, 2, 1)


def case_in(
    folder: Path, image_of: Labels = two, n_grains: int = 2, finer: int = 1, **keys: Any
) -> Case:
    """A bar with a label image in its folder, of pixels that are so many times finer."""
    row, column = np.indices((ROWS * finer, COLUMNS * finer))
    x, y = (
        ((at + 0.5) / finer - 0.5 - start) * PIXEL
        for at, start in zip((row, column), ORIGIN, strict=True)
    )
    image = image_of(x, y).astype(np.uint8)
    files_axes = keys.pop("axes", {})
    if files_axes:
        image = np.ascontiguousarray(image[::-1, ::-1])
    Image.fromarray(image).save(folder / "labels.png")
    data = tables()
    grains = (data["grains"] * 2)[:n_grains]
    data["grains"] = [grain | {"name": f"grain {k}"} for k, grain in enumerate(grains, start=1)]
    data["images"] |= {"pixel_size_nm": 1e3 * PIXEL, "origin_pixel": ORIGIN} | files_axes
    data["material"]["strain_measure"] = "small"
    specimen = {"boundaries": (), "cells": None, "labels": "labels.png", "mesh_size_um": "auto",
                "fine_mesh_size_um": "auto", "depth_um": 3.0}  # fmt: skip
    data["specimen"] |= specimen | keys
    if finer > 1:
        data["specimen"] |= {"labels_pixel_nm": 1e3 * PIXEL / finer}
    case = Case.model_validate(data, context={"file": folder / "case.toml"})
    return sized(case, BundledAdapter().capabilities())


def load_of(case: Case, size: float) -> FloatArray:
    history = stage_program([(2, 1)])
    model = build_model(case, mesh_of(case, size), history, PIXELS, adapter_of(case), 1)
    motion = {"elongation_1": 0.05, "elongation_2": 0.04, "tilt_1": 0.01, "lambda_plus_Y": 0.8}
    return model.predict(model.null_values() | motion).load


def test_labels_of_a_straight_boundary_respond_as_the_plane_within_the_error_of_the_mesh(
    tmp_path: Path,
) -> None:
    labelled = case_in(tmp_path)
    data = labelled.model_dump(mode="json")
    data["specimen"] |= {"labels": None, "boundary_point_um": (0.0, 6.0, 0.0),
                         "boundary_normal": (-SLOPE, 1.0, 0.0)}  # fmt: skip
    drawn = Case.model_validate(data, context={"file": labelled.file})
    found, plane, finer = load_of(labelled, 2.0), load_of(drawn, 2.0), load_of(drawn, 1.2)
    error = abs(plane - finer).max()
    assert 1e-3 < error / abs(plane).max() < 0.05
    assert abs(found - plane).max() < 0.5 * error


@pytest.mark.parametrize(
    ("finer", "axes"),
    [(1, {}), (3, {}), (1, {"rows_along": "-X", "columns_along": "-Y",
                            "origin_pixel": (ROWS - 1 - 29.5, COLUMNS - 1 - 14.5)})],
)  # fmt: skip
def test_labels_lie_as_the_images_do(tmp_path: Path, finer: int, axes: dict[str, Any]) -> None:
    case = case_in(tmp_path, finer=finer, axes=axes)
    (trace,) = boundary_traces(case)
    ends = trace[np.argsort(trace[:, 0])]
    np.testing.assert_allclose(ends[:, 0], [-2.0, 2.0])
    np.testing.assert_allclose(ends[:, 1], [6.4, 5.6], atol=0.6 * PIXEL / finer)
    assert [(grain, at[1] > 6.0) for grain, at in grain_places(case)] == [(0, False), (1, True)]


def four(x: FloatArray, y: FloatArray) -> IntArray:
    """Four grains that meet in threes; between two of them nothing is known."""
    inner = np.where(np.abs(x) < 0.5 * PIXEL, 0, np.where(x > 0, 2, 3))
    return np.where(y < 4 + 0.3 * np.sin(2 * x), 1, np.where(y > 8.5, 4, inner))


def test_four_grains_have_every_parameter_but_those_of_their_boundaries(tmp_path: Path) -> None:
    case = case_in(tmp_path, four, 4)
    mesh = mesh_of(case, 3.0)
    assert mesh.n_grains == 4
    model = build_model(case, mesh, stage_program([(2, 1)]), PIXELS, adapter_of(case), 1)
    candidates, names = screened(model, ("tau0", "c", "d"), None)
    assert {"tau0_grain3", "tau0_grain4", "rotation_grain4_x", "apex_shift"} < set(names)
    found = {cause.name for cause in candidates}
    assert {f"grain{k}_contrast" for k in (2, 3, 4)} < found
    assert not [name for name in found if name.startswith("boundary")]
    assert any(cause.name.startswith("boundary") for cause in LIBRARY)


def test_cells_of_labels_are_tetrahedra_whatever_the_solver_has(tmp_path: Path) -> None:
    case = case_in(tmp_path)
    assert case.specimen.cell_kind == "tet10"
    assert case.specimen.refined == 0


def test_a_written_case_with_labels_reads_back_as_it_was(tmp_path: Path) -> None:
    case = case_in(tmp_path, finer=2)
    path = tmp_path / "case.toml"
    path.write_text(case_text(case), encoding="utf-8")
    assert load_case(path).model_dump() == case.model_dump()


def test_the_mesh_hangs_on_the_labels_and_on_where_the_images_lie(tmp_path: Path) -> None:
    case = case_in(tmp_path)
    mesh = stages(case)[0]
    before = stage_inputs(mesh, case)
    moved = case.with_values_at({"images.origin_pixel": (29.5, 15.5)})
    assert stage_inputs(mesh, moved) != before
    case_in(tmp_path, lambda x, y: np.where(y > 5.0, 2, 1))
    assert stage_inputs(mesh, case) != before


@pytest.mark.parametrize(
    ("labels", "n_grains", "expected"),
    [
        (two, 3, "found the labels 1 and 2 on the face, expected 1 to 3, as there are tables "
         "[[grains]], and 0 where it is not known"),
        (lambda x, y: 0 * two(x, y), 2, "found the labels 0 alone on the face, expected 1 to 2"),
        (lambda x, y: np.where((np.abs(x) < 0.15) & (np.abs(y - 3) < 0.15), 3, two(x, y)), 3,
         "found no region of grain 3 with 0.16 µm² or more on the face"),
    ],
)  # fmt: skip
def test_labels_of_other_grains_are_refused_in_one_sentence(
    tmp_path: Path, labels: Labels, n_grains: int, expected: str
) -> None:
    case = case_in(tmp_path, labels, n_grains)
    with pytest.raises(InputError) as error:
        mesh_of(case, 2.0)
    assert str(error.value).startswith(f"{tmp_path / 'labels.png'}: specimen.labels: {expected}")


def test_labels_that_do_not_cover_the_face_are_refused(tmp_path: Path) -> None:
    case = case_in(tmp_path).with_values_at({"images.origin_pixel": (29.5, 60.0)})
    with pytest.raises(
        InputError, match="found pixels 61 to 180 of the face along Y, expected all"
    ):
        mesh_of(case, 2.0)


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
        ({"boundary_point_um": (0.0, 6.0, 0.0), "boundary_normal": (0.0, 1.0, 0.0)},
         "nothing: labels has it"),
        ({"cells": "hex20"}, '"tet10", which follow labels, or nothing'),
        ({"labels": None, "labels_pixel_nm": 50.0}, "nothing, or labels as well"),
    ],
)  # fmt: skip
def test_what_labels_have_already_is_refused(
    tmp_path: Path, keys: dict[str, Any], sentence: str
) -> None:
    with pytest.raises(ValueError) as error:
        case_in(tmp_path, **keys)
    (details,) = error.value.errors()  # type: ignore[attr-defined]
    assert details["ctx"]["expected"] == sentence


def test_labels_that_are_not_there_are_refused_with_their_key(tmp_path: Path) -> None:
    case = case_in(tmp_path)
    (tmp_path / "labels.png").unlink()
    with pytest.raises(InputError, match="labels.png: specimen.labels: found no image"):
        mesh_of(case, 2.0)
