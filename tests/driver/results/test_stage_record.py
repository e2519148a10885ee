from __future__ import annotations

import json
from pathlib import Path

import pytest

from driver.results.stage_record import Record, read_record, write_record

RECORD: Record = {
    "mesh": {
        "key": "ab12",
        "outputs": ["mesh.med", "mesh.vtu"],
        "digests": {"mesh.med": "cd34", "mesh.vtu": "ef56"},
        "finished": "2026-01-02T03:04:05+00:00",
        "seconds": 1.25,
    }
}


def test_the_record_is_a_json_file_of_the_stages_by_name(tmp_path: Path) -> None:
    write_record(tmp_path, RECORD)
    assert json.loads((tmp_path / "stages.json").read_text("utf-8")) == RECORD
    assert [path.name for path in tmp_path.iterdir()] == ["stages.json"]
    assert read_record(tmp_path) == RECORD


def test_a_record_of_an_earlier_version_without_hashes_of_the_results_is_read(
    tmp_path: Path,
) -> None:
    entry = {"key": "ab12", "outputs": [], "finished": "", "seconds": 2}
    (tmp_path / "stages.json").write_text(json.dumps({"mesh": entry}), encoding="utf-8")
    assert read_record(tmp_path) == {"mesh": entry}


def test_where_nothing_has_run_no_stage_is_finished(tmp_path: Path) -> None:
    assert read_record(tmp_path) == {}
    (tmp_path / "stages.json").mkdir()
    assert read_record(tmp_path) == {}


@pytest.mark.parametrize(
    "damage",
    [
        {"key": 5}, {"key": None}, {"outputs": "mesh.med"}, {"outputs": [5]}, {"digests": []},
        {"seconds": "2"}, {"inputs": []}, {"inputs": None}, {"inputs": 3}, {"outputs": [""]},
        {"outputs": ["../history.csv"]}, {"outputs": ["/history.csv"]}, {"outputs": ["a\0b"]},
        {"digests": {"../history.csv": "cd34"}}, {"digests": {"/history.csv": "cd34"}},
        {"digests": {"mesh.med": None}}, {"inputs": {"version": ["1"]}}, {"finished": 3},
    ],
)  # fmt: skip
def test_one_entry_that_is_damaged_makes_the_whole_record_none(
    damage: dict[str, object], tmp_path: Path
) -> None:
    record = {"measure": RECORD["mesh"], "mesh": RECORD["mesh"] | damage}
    (tmp_path / "stages.json").write_text(json.dumps(record), encoding="utf-8")
    assert read_record(tmp_path) == {}


def test_a_record_nested_beyond_all_measure_is_none(tmp_path: Path) -> None:
    (tmp_path / "stages.json").write_text(100_000 * "[", encoding="utf-8")
    assert read_record(tmp_path) == {}


def test_a_record_that_is_cut_off_is_none(tmp_path: Path) -> None:
    write_record(tmp_path, RECORD)
    path = tmp_path / "stages.json"
    path.write_text(path.read_text("utf-8")[:-10], encoding="utf-8")
    assert read_record(tmp_path) == {}
