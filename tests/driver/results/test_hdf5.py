from __future__ import annotations

import csv
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
from numpy.typing import NDArray

from driver.results.hdf5 import (
    FrameSeries,
    ResultError,
    open_hdf5,
    prismid_version,
    read_hdf5,
    write_csv,
    write_hdf5,
)

ROOT = Path(__file__).parents[3]
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


def test_who_asks_for_a_file_that_no_stage_writes_is_not_told_to_delete_it(
    path: Path, tmp_path: Path
) -> None:
    measured = tmp_path / "measure.h5"
    own = tmp_path / "history.csv"
    for file in (measured, own):
        file.write_text("time_s,force_N\n", encoding="utf-8")
    with pytest.raises(ResultError, match="expected a result of prismid; delete it, and"):
        read_hdf5(measured)
    with pytest.raises(ResultError, match=r"expected a result of prismid$"):
        read_hdf5(str(own))


def test_an_absent_file_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(ResultError, match="found no readable HDF5 file"):
        read_hdf5(tmp_path / "absent.h5")


def test_frames_that_come_in_blocks_are_read_as_one_dataset_or_frame_by_frame(
    tmp_path: Path,
) -> None:
    path = tmp_path / "series.h5"
    blocks = ({"motion": NOISE[k : k + 16]} for k in range(0, 60, 16))
    write_hdf5(
        path, {"time": (np.arange(60.0), "s")}, series=FrameSeries(60, {"motion": "µm"}, blocks)
    )
    np.testing.assert_array_equal(read_hdf5(path)["motion"], NOISE)
    opened = open_hdf5(path, ("motion",))
    np.testing.assert_array_equal(opened["time"], np.arange(60.0))
    assert opened["motion"].shape == (60, 40) and len(opened["motion"]) == 60
    np.testing.assert_array_equal(opened["motion"][37], NOISE[37])
    np.testing.assert_array_equal(np.array(list(opened["motion"])), NOISE)
    with h5py.File(path, "r") as file:
        assert file["motion"].attrs["unit"] == "µm"


@pytest.mark.parametrize("room", [100, 3000, 20000, 380000])
def test_a_file_for_which_there_is_no_room_is_refused(tmp_path: Path, room: int) -> None:
    """The system itself lets no file of the process grow further."""
    code = (
        "import resource, sys; from pathlib import Path; import numpy as np;"
        "from driver.results.hdf5 import write_hdf5;"
        f"resource.setrlimit(resource.RLIMIT_FSIZE, ({room}, {room}));"
        "write_hdf5(Path(sys.argv[1]), {'noise': (np.random.default_rng(0).random(50000), '1')})"
    )
    command = [sys.executable, "-c", code, str(tmp_path / "large.h5")]
    ended = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False)
    assert ended.returncode == 1 and ended.stderr.strip().endswith("File too large")
    assert "OSError: [Errno 27]" in ended.stderr


def test_a_table_has_six_digits_and_columns_of_one_length(tmp_path: Path) -> None:
    path = tmp_path / "some.csv"
    write_csv(path, {"image": range(2), "load": np.array([1 / 3, 1e-9]), "name": ["a", "b,c"]})
    with path.open(encoding="utf-8", newline="") as file:
        assert list(csv.reader(file)) == [
            ["image", "load", "name"], ["0", "0.333333", "a"], ["1", "1e-09", "b,c"],
        ]  # fmt: skip
    with pytest.raises(ValueError):
        write_csv(path, {"image": range(2), "load": [1.0]})
