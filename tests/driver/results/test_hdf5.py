from __future__ import annotations

import csv
from pathlib import Path

import h5py
import numpy as np
import pytest
from numpy.typing import NDArray

from driver.results.hdf5 import (
    ResultError,
    prismid_version,
    read_hdf5,
    write_csv,
    write_hdf5,
)

NOISE = np.random.default_rng(0).standard_normal((60, 40))


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "some.h5"
    arrays: dict[str, tuple[NDArray[np.generic] | float, str]] = {
        "time": (np.arange(3.0), "s"),
        "after/load": (np.array([1.0, np.nan, -np.inf]), "µN"),
        "after/motion": (NOISE.astype(np.float32), "µm"),
        "noise": (NOISE, "µm"),
        "sigma": (0.009, "µm"),
        "rows": (np.arange(4), "pixel"),
    }
    write_hdf5(path, arrays, {"reason": "the Newton decrement is 0.04 σ"})
    return path


def test_what_was_written_is_read_bit_for_bit_with_its_units(path: Path) -> None:
    found = read_hdf5(path)
    assert set(found) == {"time", "after/load", "after/motion", "noise", "sigma", "rows"}
    np.testing.assert_array_equal(found["noise"], NOISE)
    np.testing.assert_array_equal(found["after/load"], [1.0, np.nan, -np.inf])
    assert found["after/motion"].dtype == np.float32 and float(found["sigma"]) == 0.009
    with h5py.File(path, "r") as file:
        assert file["after/load"].attrs["unit"] == "µN"
        assert file.attrs["reason"] == "the Newton decrement is 0.04 σ"
        assert file.attrs["prismid"] == prismid_version() and "T" in file.attrs["written"]


@pytest.mark.parametrize("kept", [0.0, 0.1, 0.5, 0.9, 0.999])
def test_a_truncated_file_is_one_sentence(path: Path, kept: float) -> None:
    whole = path.read_bytes()
    path.write_bytes(whole[: int(kept * len(whole))])
    with pytest.raises(ResultError) as error:
        read_hdf5(path)
    message = str(error.value)
    assert message.startswith(f"{path}: found no readable HDF5 file")
    assert "expected a result of prismid" in message and "\n" not in message


def test_a_damaged_array_is_one_sentence(path: Path) -> None:
    content = bytearray(path.read_bytes())
    with h5py.File(path, "r") as file:
        chunk = file["noise"].id.get_chunk_info(0)
    content[chunk.byte_offset : chunk.byte_offset + chunk.size] = bytes(chunk.size)
    path.write_bytes(bytes(content))
    with pytest.raises(ResultError, match="found no readable HDF5 file"):
        read_hdf5(path)


def test_an_absent_file_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(ResultError, match="found no readable HDF5 file"):
        read_hdf5(tmp_path / "absent.h5")


def test_a_table_has_six_digits_and_columns_of_one_length(tmp_path: Path) -> None:
    path = tmp_path / "some.csv"
    write_csv(path, {"image": range(2), "load": np.array([1 / 3, 1e-9]), "name": ["a", "b,c"]})
    with path.open(encoding="utf-8", newline="") as file:
        assert list(csv.reader(file)) == [
            ["image", "load", "name"], ["0", "0.333333", "a"], ["1", "1e-09", "b,c"],
        ]  # fmt: skip
    with pytest.raises(ValueError):
        write_csv(path, {"image": range(2), "load": [1.0]})
