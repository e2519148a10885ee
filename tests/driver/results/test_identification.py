from __future__ import annotations

import json
from pathlib import Path

import h5py
import pytest

from driver.results.hdf5 import ResultError
from driver.results.identification import read_identification

TEXTS = {
    "names": json.dumps(["tau0", "c"]), "units": json.dumps(["MPa", "MPa"]),
    "all_values": json.dumps({"tau0": 21, "c": 44e3, "n": 10.0}),
    "warnings": json.dumps(["c stands at its bound"]), "reason": "it ended", "converged": "yes",
}  # fmt: skip


def written(path: Path, **changes: str | None) -> Path:
    with h5py.File(path, "w") as file:
        for name, text in (TEXTS | changes).items():
            if text is not None:
                file.attrs[name] = text
    return path


def test_the_words_of_an_identification_are_read_back(tmp_path: Path) -> None:
    told = read_identification(written(tmp_path / "identify.h5"))
    assert told.names == ("tau0", "c") and told.units == ("MPa", "MPa")
    assert told.values == {"tau0": 21.0, "c": 44e3, "n": 10.0}
    assert told.warnings == ("c stands at its bound",)
    assert told.reason == "it ended" and told.converged
    assert not read_identification(written(tmp_path / "open.h5", converged="")).converged


@pytest.mark.parametrize("name", TEXTS)
def test_an_attribute_that_is_absent_is_named(name: str, tmp_path: Path) -> None:
    with pytest.raises(ResultError, match=f"found no attribute {name}"):
        read_identification(written(tmp_path / "identify.h5", **{name: None}))


def test_parameters_that_are_no_json_are_a_damaged_result(tmp_path: Path) -> None:
    with pytest.raises(ResultError, match="found no readable parameters"):
        read_identification(written(tmp_path / "identify.h5", all_values="[1, 2"))
