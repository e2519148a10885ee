"""A response on disk comes back as it was, and anything else is told in one sentence."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from datetime import datetime
from pathlib import Path

import h5py
import numpy as np
import pytest

from solver_adapters.interface import CellFields, Response, Trajectory
from solver_adapters.response_file import (
    Provenance,
    prismid_version,
    read_provenance,
    read_response,
    write_response,
)
from solver_adapters.result_files import ResultFileError

RNG = np.random.default_rng(5)
CELLS = CellFields(
    RNG.random((3, 7, 6)), RNG.random((3, 7, 24)), RNG.random((3, 7, 24)), RNG.random((3, 7, 3))
)
RESPONSE = Response(
    RNG.random((3, 500, 3)), RNG.random(3), RNG.random((2, 3, 500, 3)), RNG.random((2, 3)),
    9, 31, 2, 1, RNG.random(9), {"assembly": 1.5, "read": 0.25}, CELLS,
    trajectory=Trajectory(RNG.random(10), RNG.random((10, 30, 3))),
)  # fmt: skip
ORIGIN = Provenance("bar", "bar 1.0", "0123")


OF_48 = replace(CELLS, slip=RNG.random((3, 7, 48)), accumulated_slip=RNG.random((3, 7, 48)))


@pytest.mark.parametrize(
    "response",
    [
        RESPONSE,
        replace(RESPONSE, cells=None, trajectory=None, seconds={}),
        replace(RESPONSE, cells=OF_48),
    ],
)
def test_a_response_comes_back_as_it_was(tmp_path: Path, response: Response) -> None:
    path = tmp_path / "response.h5"
    write_response(path, response, ORIGIN)
    found = read_response(path)
    for item in fields(Response):
        there, here = getattr(found, item.name), getattr(response, item.name)
        if item.name in ("cells", "trajectory") and here is not None:
            for part in fields(here):
                np.testing.assert_array_equal(getattr(there, part.name), getattr(here, part.name))
        else:
            np.testing.assert_array_equal(there, here)
            assert type(there) is type(here)
    assert [file.name for file in tmp_path.iterdir()] == ["response.h5"]


def test_every_dataset_has_unit_and_description(tmp_path: Path) -> None:
    write_response(tmp_path / "r.h5", RESPONSE, ORIGIN)
    units: dict[str, str] = {}

    def look(name: str, item: h5py.Group | h5py.Dataset) -> None:
        if isinstance(item, h5py.Dataset):
            units[name] = item.attrs["unit"]
            assert item.attrs["description"]

    with h5py.File(tmp_path / "r.h5") as file:
        file.visititems(look)
    expected = {f"cells/{item.name}" for item in fields(CellFields)}
    expected |= {f"trajectory/{item.name}" for item in fields(Trajectory)}
    expected |= {item.name for item in fields(Response)} - {"cells", "seconds", "trajectory"}
    assert set(units) == expected | {"seconds/assembly", "seconds/read"}
    assert (units["displacement"], units["force"]) == ("µm", "µN")
    assert (units["cells/stress"], units["cells/rotation"]) == ("MPa", "rad")


def test_the_provenance_is_kept(tmp_path: Path) -> None:
    write_response(tmp_path / "r.h5", RESPONSE, ORIGIN)
    found = read_provenance(tmp_path / "r.h5")
    assert replace(found, prismid="", written="") == ORIGIN
    assert found.prismid == prismid_version()
    offset = datetime.fromisoformat(found.written).utcoffset()
    assert offset is not None and not offset


def _foreign(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file["force"] = np.zeros(3)


def _incomplete(path: Path) -> None:
    with h5py.File(path, "r+") as file:
        del file["d_force"]


def _not_finite(path: Path) -> None:
    with h5py.File(path, "r+") as file:
        file["force"][1] = np.nan


def _other_shape(path: Path) -> None:
    with h5py.File(path, "r+") as file:
        del file["displacement"]
        file["displacement"] = np.zeros((2, 500, 3))


def _other_trajectory(path: Path) -> None:
    with h5py.File(path, "r+") as file:
        del file["trajectory/displacement"]
        file["trajectory/displacement"] = np.zeros((9, 30, 3))


def _other_type(path: Path) -> None:
    with h5py.File(path, "r+") as file:
        del file["steps"]
        file["steps"] = np.zeros(3)


@pytest.mark.parametrize(
    ("damage", "found"),
    [
        (lambda path: path.unlink(), "found nothing, expected a response"),
        (lambda path: path.write_bytes(b""), "found an empty file, expected a response"),
        (lambda path: path.write_bytes(path.read_bytes()[:3000]), "found a truncated HDF5 file"),
        (lambda path: path.write_text("force 3\n"), "found no HDF5 file, expected a response"),
        (_foreign, "found HDF5 of another origin, expected a response"),
        (_incomplete, "found no readable dataset d_force, expected a whole response"),
        (_not_finite, "found values of force that are no finite numbers, expected such"),
        (_other_shape, "found displacement of shape (2, 500, 3), expected (3, 500, 3)"),
        (
            _other_trajectory,
            "found trajectory/displacement of shape (9, 30, 3), expected (10, 30, 3)",
        ),
        (_other_type, "found damaged HDF5 (TypeError), expected a response"),
    ],
    ids=[
        "absent",
        "empty",
        "truncated",
        "no HDF5",
        "foreign",
        "incomplete",
        "not finite",
        "shape",
        "trajectory",
        "type",
    ],
)
def test_what_is_no_response_is_told_in_one_sentence(
    tmp_path: Path, damage: Callable[[Path], None], found: str
) -> None:
    path = tmp_path / "response.h5"
    write_response(path, RESPONSE, ORIGIN)
    damage(path)
    with pytest.raises(ResultFileError) as error:
        read_response(path)
    assert str(error.value).startswith(f"{path}: {found}")
    assert "\n" not in str(error.value)


def test_a_provenance_without_a_key_is_told_in_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / "response.h5"
    write_response(path, RESPONSE, ORIGIN)
    with h5py.File(path, "r+") as file:
        del file.attrs["key"]
    with pytest.raises(ResultFileError, match=r"found damaged HDF5 \(KeyError\), expected a resp"):
        read_provenance(path)


def test_no_flipped_byte_changes_a_number_or_breaks_the_reader(tmp_path: Path) -> None:
    path = tmp_path / "response.h5"
    small = replace(
        RESPONSE, cells=None, displacement=RESPONSE.displacement[:, :20],
        d_displacement=RESPONSE.d_displacement[:, :, :20], notes=("a note",),
    )  # fmt: skip
    write_response(path, small, ORIGIN)
    content = path.read_bytes()
    told = 0
    for place in range(0, len(content), 211):
        spoiled = bytearray(content)
        spoiled[place] ^= 0x41
        path.write_bytes(spoiled)
        try:
            # Not tried by another process first: this one has to stand it.
            read_provenance(path, as_written=True)
            found = read_response(path, as_written=True)
        except ResultFileError:
            told += 1
        else:
            np.testing.assert_array_equal(found.displacement, small.displacement)
            np.testing.assert_array_equal(found.force, small.force)
            np.testing.assert_array_equal(found.d_displacement, small.d_displacement)
    assert told > 10


def test_a_file_of_unknown_origin_is_tried_by_another_process_and_one_as_written_is_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "response.h5"
    write_response(path, RESPONSE, ORIGIN)
    monkeypatch.setattr("solver_adapters.response_file.can_be_read", lambda *asked: False)
    for read in (read_response, read_provenance):
        with pytest.raises(ResultFileError, match=f"^{path}: found HDF5 that cannot be read, "):
            read(path)
    assert read_provenance(path, as_written=True) == replace(
        ORIGIN, prismid=read_provenance(path, as_written=True).prismid,
        written=read_provenance(path, as_written=True).written,
    )  # fmt: skip
    np.testing.assert_array_equal(read_response(path, as_written=True).force, RESPONSE.force)
