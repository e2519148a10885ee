"""The folder of an export: what is replaced in it, and what is left alone."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from driver.export import command as export
from driver.export.command import ExportError, export_case
from driver.results.hdf5 import ResultError, write_hdf5
from tests.driver.export.exported import (
    Results,
    contents,
)


def test_files_of_others_are_left_alone_and_an_earlier_export_is_replaced(results: Results) -> None:
    results.to.mkdir()
    (results.to / "notes.md").write_text("mine")
    export_case(results.case_path, results.to)
    before = contents(results.to)
    results.load["after"] += 1.0
    write_hdf5(results.folder / "diagnosis.h5", results.predictions("after"))
    export_case(results.case_path, results.to)
    after = contents(results.to)
    assert after.keys() == before.keys() and after["notes.md"] == b"mine"
    assert after["loads.csv"] != before["loads.csv"]
    assert after["knots.csv"] == before["knots.csv"]


@pytest.mark.parametrize("name", ["README.txt", "loads.csv"])
def test_a_file_of_others_is_never_overwritten(results: Results, name: str) -> None:
    results.to.mkdir()
    (results.to / name).write_text("mine")
    with pytest.raises(ExportError, match=f"--to: found a file {name} that is no export"):
        export_case(results.case_path, results.to)
    assert contents(results.to) == {name: b"mine"}


def test_a_file_in_the_place_of_the_folder_is_refused(results: Results) -> None:
    results.to.write_text("mine")
    with pytest.raises(ExportError, match="--to: found a file, expected a folder"):
        export_case(results.case_path, results.to)
    assert results.to.read_text() == "mine"


def test_a_broken_result_leaves_the_earlier_export_as_it_was(results: Results) -> None:
    export_case(results.case_path, results.to)
    before = contents(results.to)
    whole = (results.folder / "identify.h5").read_bytes()
    (results.folder / "identify.h5").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ResultError, match="identify.h5"):
        export_case(results.case_path, results.to)
    assert contents(results.to) == before


def test_an_export_that_breaks_off_leaves_the_earlier_one_and_nothing_else(
    results: Results, monkeypatch: pytest.MonkeyPatch
) -> None:
    export_case(results.case_path, results.to)
    before = contents(results.to)
    results.load["after"] += 1.0
    write_hdf5(results.folder / "diagnosis.h5", results.predictions("after"))

    def full(path: Path, columns: Mapping[str, object]) -> None:
        path.write_text("half of it")
        raise OSError("No space left on device")

    monkeypatch.setattr(export, "write_csv", full)
    with pytest.raises(OSError, match="No space"):
        export_case(results.case_path, results.to)
    assert contents(results.to) == before
    assert not list(results.to.glob("partial-*"))


def test_a_volume_of_others_is_neither_overwritten_nor_removed(results: Results) -> None:
    results.to.mkdir()
    (results.to / "volume_model.vtkhdf").write_text("mine")
    with pytest.raises(ExportError, match="found a file volume_model.vtkhdf that is no export"):
        export_case(results.case_path, results.to)
    assert not results.solver.asked  # told before the simulations
    export_case(results.case_path, results.to, volume=False)
    assert (results.to / "volume_model.vtkhdf").read_text() == "mine"


def test_a_file_that_no_export_has_written_stays_beside_one(results: Results) -> None:
    results.to.mkdir()
    mine = {"volume_model.med": b"mine", "volume_extended.vtkhdf": b"mine, too"}
    for name, content in mine.items():
        (results.to / name).write_bytes(content)
    for _ in range(2):
        export_case(results.case_path, results.to, volume=False)
        assert mine.items() <= contents(results.to).items()
    cases: list[dict[str, Any]] = [{"med": True}, {}]
    for options in cases:
        with pytest.raises(ExportError, match="found a file volume_.* that is no export"):
            export_case(results.case_path, results.to, **options)
    assert mine.items() <= contents(results.to).items()
    assert not results.solver.asked


def test_a_list_that_somebody_has_edited_removes_nothing_outside_the_folder(
    results: Results,
) -> None:
    export_case(results.case_path, results.to, volume=False)
    outside = results.to.parent / "mine.txt"
    outside.write_text("mine")
    with (results.to / "README.txt").open("a", encoding="utf-8") as readme:
        readme.write(f"  ../mine.txt\n  {outside}\n")
    export_case(results.case_path, results.to, volume=False)
    assert outside.read_text() == "mine"


def test_what_an_earlier_export_holds_beyond_this_one_is_removed(results: Results) -> None:
    export_case(results.case_path, results.to, volume=False)
    extra = results.to / "surface" / "surface_0003.vtu"
    extra.write_text("of a longer test")
    export_case(results.case_path, results.to, volume=False)
    assert extra.is_file()
    with (results.to / "README.txt").open("a", encoding="utf-8") as readme:
        readme.write("  surface/surface_0003.vtu\n")
    export_case(results.case_path, results.to, volume=False)
    assert not extra.exists()


def test_a_file_in_the_place_of_a_folder_of_the_export_is_refused(results: Results) -> None:
    results.to.mkdir()
    (results.to / "surface").write_text("mine")
    with pytest.raises(ExportError, match="found a file surface that is no export"):
        export_case(results.case_path, results.to)
    assert contents(results.to) == {"surface": b"mine"}
