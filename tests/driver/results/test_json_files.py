from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from driver.results.hdf5 import ResultError
from driver.results.json_files import json_number, read_json, write_json


@pytest.mark.parametrize(
    ("value", "held"), [(1.5, 1.5), (np.float64(2), 2.0), (np.inf, None), (np.nan, None)]
)
def test_what_json_has_no_number_for_is_null(value: float, held: float | None) -> None:
    found = json_number(value)
    assert found == held and type(found) is type(held)


def test_a_record_is_read_back_as_it_was_and_ends_its_last_line(tmp_path: Path) -> None:
    record = {"text": "λ⁺ = 0.8", "values": [1, 2.5, None]}
    write_json(tmp_path / "record.json", record)
    text = (tmp_path / "record.json").read_text("utf-8")
    assert json.loads(text) == record and text.endswith("}\n") and "λ⁺" in text
    assert read_json(tmp_path / "record.json") == record


@pytest.mark.parametrize("text", ['{"text": "cut', "[1, 2]", ""])
def test_a_file_that_holds_no_record_is_a_damaged_result(text: str, tmp_path: Path) -> None:
    (tmp_path / "record.json").write_text(text, encoding="utf-8")
    with pytest.raises(ResultError, match="record.json: found no re"):
        read_json(tmp_path / "record.json")
