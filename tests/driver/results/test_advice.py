from __future__ import annotations

import json
from pathlib import Path

import pytest

from driver.results.advice import Advice, read_advised_text, write_advice
from driver.results.hdf5 import ResultError

ADVICE = Advice(("load_gain", "elastic_scale"), (("twice the stops", 3.5), ("", 1.25)), "Stop λ.")


def test_an_advice_is_a_json_file_with_its_changes_in_their_order(tmp_path: Path) -> None:
    write_advice(tmp_path, ADVICE)
    assert json.loads((tmp_path / "advice.json").read_text("utf-8")) == {
        "causes": ["load_gain", "elastic_scale"],
        "changes": [
            {"change": "twice the stops", "apart_sigma": 3.5},
            {"change": "", "apart_sigma": 1.25},
        ],
        "text": "Stop λ.",
    }
    assert read_advised_text(tmp_path / "advice.json") == "Stop λ."


def test_an_advice_without_its_sentence_is_a_damaged_result(tmp_path: Path) -> None:
    (tmp_path / "advice.json").write_text('{"causes": []}', encoding="utf-8")
    with pytest.raises(ResultError, match=r"advice.json: found no entry text.*stage advise alone"):
        read_advised_text(tmp_path / "advice.json")
