"""Every format of results is read as named arrays."""

from __future__ import annotations

import json
from pathlib import Path

import h5py
import numpy as np
import pytest

from driver.results.hdf5 import ResultError
from driver.verify.numbers import FORMATS, numbers_of


def test_numbers_and_texts_of_a_record_stand_under_their_keys_and_times_are_left_out(
    tmp_path: Path,
) -> None:
    path = tmp_path / "a.json"
    record = {
        "prismid": "1", "seconds": 3.0, "verdict": "named",
        "steps": [{"cause": "a", "estimate": [1, 2.5], "none": None, "seconds": 1.0}],
    }  # fmt: skip
    path.write_text(json.dumps(record), encoding="utf-8")
    found = {name: value.tolist() for name, value in numbers_of(path).items()}
    assert found == {
        "verdict": "named", "steps[0].cause": "a", "steps[0].estimate": [1.0, 2.5],
        "steps[0].none": "null",
    }  # fmt: skip


def test_datasets_and_attributes_are_read_but_when_they_were_written(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        file.attrs.update({"written": "today", "prismid": "1", "reason": "converged"})
        file["group/load"] = [1.0, 2.0]
    found = {name: value.tolist() for name, value in numbers_of(path).items()}
    assert found == {"group/load": [1.0, 2.0], "attribute reason": "converged"}


def test_columns_of_a_table_are_numbers_where_all_of_them_are(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("image,stopped\n0,\n1,lost\n", encoding="utf-8")
    found = {name: value.tolist() for name, value in numbers_of(path).items()}
    assert found == {"image": [0.0, 1.0], "stopped": ["", "lost"]}


def test_numbers_of_a_deck_are_read_in_their_order(tmp_path: Path) -> None:
    path = tmp_path / "job.inp"
    path.write_text("*NODE\n1, 0.5, -2.E-3\n** 1D3\n", encoding="utf-8")
    np.testing.assert_array_equal(numbers_of(path)["numbers"], [1.0, 0.5, -2e-3, 1e3])


def test_of_a_case_the_numbers_are_compared_and_names_of_files_are_not(tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    path.write_text('[images]\nframes = "a.tif"\npixel_um = 0.5\nrows = [1.0]\n', encoding="utf-8")
    assert set(numbers_of(path)) == {"images.pixel_um", "images.rows"}


@pytest.mark.parametrize("ending", sorted(set(FORMATS) - {".inp", ".comm"}))
def test_a_file_that_is_damaged_is_named_in_a_sentence(ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"a{ending}"
    path.write_bytes(b'"\xff\0,[{')
    with pytest.raises(ResultError, match=f"^{path}: found .* expected a result of"):
        numbers_of(path)
