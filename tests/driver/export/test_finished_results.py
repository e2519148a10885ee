from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import h5py
import pytest

from driver.case.model import write_case
from driver.export.command import ExportError, export_case
from driver.results import reader
from driver.results.hdf5 import ResultError
from meshes.files import read_med
from meshes.prism_mesh import PrismMesh
from tests.driver.export.exported import (
    Results,
)
from tests.driver.stated_sizes import stated_case


@pytest.mark.parametrize("missing", ["mesh", "measure", "identify"])
def test_a_missing_stage_is_named_with_the_command_that_makes_it(
    results: Results, missing: str
) -> None:
    results.record(*({"mesh", "measure", "identify"} - {missing}))
    with pytest.raises(ExportError) as error:
        export_case(results.case_path, results.to)
    assert str(error.value) == (
        f"{results.folder}: stage {missing}: found no results, or damaged ones, expected those of "
        f"the case as it is (`prismid run {results.case_path} --until identify` makes them)"
    )
    assert not results.to.exists()


def test_a_case_that_was_never_run_is_told_so(tmp_path: Path) -> None:
    write_case(stated_case(), tmp_path / "case.toml")
    with pytest.raises(ExportError, match="stage mesh: found no results"):
        export_case(tmp_path / "case.toml", tmp_path / "to")


def test_a_lost_result_file_counts_as_missing(results: Results) -> None:
    (results.folder / "identify.h5").unlink()
    with pytest.raises(ExportError, match="stage identify: found no results"):
        export_case(results.case_path, results.to)


def test_results_of_an_edited_case_are_not_passed_off_as_its_own(results: Results) -> None:
    results.edit("tau0_MPa = 40.0", "tau0_MPa = 30.0")
    with pytest.raises(ExportError, match="stage identify: found results of another state"):
        export_case(results.case_path, results.to)


@pytest.mark.parametrize("why", ["never run", "of another state"])
def test_without_a_diagnosis_of_the_case_the_rest_is_exported(results: Results, why: str) -> None:
    if why == "never run":
        results.record("mesh", "measure", "identify")
    else:
        results.edit("refit = 5", "refit = 3")
    export_case(results.case_path, results.to)
    names = [*results.frames()[0][1].point_data, *results.table("loads.csv")[0],
             *results.table("knots.csv")[0], *results.table("parameters.csv")[0]]  # fmt: skip
    assert "load_model_uN" in names and not [name for name in names if "extended" in name]
    assert "no finished diagnosis" in (results.to / "README.txt").read_text("utf-8")


@pytest.mark.parametrize(
    "text", ["", "[]", "5", "null", '{"mesh": 5}', '{"mesh": ["key", "outputs"]}',
             '{"mesh": {"key": "a", "outputs": 5}}', '{"mesh": {"key": "a", "outputs": [5]}}'],
)  # fmt: skip
def test_a_damaged_record_is_no_record(results: Results, text: str) -> None:
    (results.folder / "stages.json").write_text(text)
    with pytest.raises(
        ExportError, match="stage mesh: found no results, or damaged ones, expected"
    ):
        export_case(results.case_path, results.to)


def other_parameters(results: Results) -> None:
    with h5py.File(results.folder / "identify.h5", "a") as file:
        file.attrs["names"] = json.dumps(["tau0"])


def fewer_images(results: Results) -> None:
    with h5py.File(results.folder / "measure.h5", "a") as file:
        force = file["force"][:2]
        del file["force"]
        file["force"] = force


def of_another_stage(results: Results) -> None:
    measured = (results.folder / "measure.h5").read_bytes()
    (results.folder / "identify.h5").write_bytes(measured)


@pytest.mark.parametrize(
    ("damage", "stage", "said"),
    [
        (of_another_stage, "identify", "identify.h5: found no numbers final/load"),
        (other_parameters, "identify", "identify.h5: found no readable parameters"),
        (fewer_images, "measure", r"measure.h5: found force of shape \(2,\) in place of \(3\)"),
        (
            lambda results: (results.folder / "mesh.med").write_text("half"),
            "mesh",
            "mesh.med: found no readable mesh",
        ),
        (
            lambda results: (results.folder / "diagnosis.json").write_text('{"extended": 5}'),
            "diagnose",
            "diagnosis.json: found no readable extended model",
        ),
        (
            lambda results: (results.folder / "measure.h5").write_text("half"),
            "measure",
            "measure.h5: found no readable HDF5 file",
        ),
    ],
)
def test_a_damaged_result_is_one_sentence_that_names_its_stage(
    results: Results, damage: Callable[[Results], object], stage: str, said: str
) -> None:
    damage(results)
    with pytest.raises(ResultError, match=said) as error:
        export_case(results.case_path, results.to)
    message = str(error.value)
    assert message.endswith(f"`prismid run` makes it anew, running the stage {stage} alone")
    assert "\n" not in message
    assert not results.to.exists()


def test_results_that_a_run_replaces_meanwhile_are_not_mixed(
    results: Results, monkeypatch: pytest.MonkeyPatch
) -> None:
    def replaced(path: Path) -> PrismMesh:
        results.record("mesh", "measure")
        return read_med(path)

    monkeypatch.setattr(reader, "read_med", replaced)
    with pytest.raises(ExportError, match="found a run that replaces results"):
        export_case(results.case_path, results.to)
