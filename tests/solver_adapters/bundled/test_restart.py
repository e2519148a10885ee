"""What is written down of a run, and what is not taken for it."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from solver_adapters.bundled.fem.state import Increment, Instant
from solver_adapters.bundled.law import NS
from solver_adapters.bundled.law.state_layout import S_ACC, S_X2
from solver_adapters.bundled.restart import FILE, Checkpoint, fits, read, write
from solver_adapters.interface import SolverError


def checkpoint() -> Checkpoint:
    rng = np.random.default_rng(3)
    instant = Instant(
        1.5, rng.random((4, 3)), rng.random((8, 9)), rng.random((8, S_X2)), 7.5,
        rng.random((4, 3, 2)), rng.random((8, S_ACC, 2)), rng.random(2),
    )  # fmt: skip
    u, slips = rng.random((4, 3)), rng.random((8, NS))
    last = {False: Increment(u, slips, rng.random(6), 0.5, rng.random((4, 3)))}
    ends, course = [0.5, 1.0, 1.5], [rng.random((4, 3)) for _ in range(3)]
    return Checkpoint(3, instant, last, {"force": rng.random(5)}, ends, course, (3, 9, 1, 0))


def test_a_checkpoint_is_read_as_it_was_written(tmp_path: Path) -> None:
    written = checkpoint()
    write(tmp_path, "key", written)
    found = read(tmp_path, "key")
    assert found is not None
    assert (found.index, found.ends, found.counts) == (3, [0.5, 1.0, 1.5], (3, 9, 1, 0))
    for item in fields(Instant):
        np.testing.assert_array_equal(
            getattr(found.instant, item.name), getattr(written.instant, item.name)
        )
    for item in fields(Increment):
        np.testing.assert_array_equal(
            getattr(found.last[False], item.name), getattr(written.last[False], item.name)
        )
    assert list(found.last) == [False]
    np.testing.assert_array_equal(found.course, written.course)
    np.testing.assert_array_equal(found.rows["force"], written.rows["force"])


def test_no_file_another_key_and_a_damaged_file_are_no_checkpoint(tmp_path: Path) -> None:
    assert read(tmp_path, "key") is None
    write(tmp_path, "key", checkpoint())
    assert read(tmp_path, "other") is None
    whole = (tmp_path / FILE).read_bytes()
    for damaged in (b"", b"no archive", whole[: len(whole) // 2]):
        (tmp_path / FILE).write_bytes(damaged)
        assert read(tmp_path, "key") is None


def test_a_folder_in_the_place_of_the_file_is_refused_before_the_run(tmp_path: Path) -> None:
    (tmp_path / FILE).mkdir()
    with pytest.raises(SolverError, match="found a folder; expected a checkpoint or nothing"):
        read(tmp_path, "key")


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("counts", np.array([3, 9])),
        ("counts", np.array(3)),
        ("index", np.array([1, 2])),
        ("index", np.array("a")),
        ("ends", np.array(0.5)),
    ],
)
def test_entries_of_other_shapes_are_no_checkpoint(
    tmp_path: Path, name: str, value: NDArray[np.generic]
) -> None:
    write(tmp_path, "key", checkpoint())
    with np.load(tmp_path / FILE) as stored:
        arrays = {**stored, name: value}
    np.savez(tmp_path / FILE, **arrays)
    assert read(tmp_path, "key") is None


TIMES = np.array([0.0, 0.5, 1.0, 1.5, 2.0])


def of_run(found: Checkpoint) -> bool:
    """Whether it is one of the run whose checkpoint the first one is."""
    start = replace(checkpoint().instant, time=0.0)
    return fits(found, start, {"force": np.zeros(5)}, TIMES, 6)


def test_a_checkpoint_of_the_run_fits_it() -> None:
    assert of_run(checkpoint())


def instant(**changes: Any) -> Instant:
    return replace(checkpoint().instant, **changes)


@pytest.mark.parametrize(
    "changes",
    [
        {"index": 99},
        {"index": 5},
        {"index": -1},
        {"index": 2},  # that of another index
        {"rows": {}},
        {"rows": {"force": np.zeros(4)}},
        {"rows": {"force": np.full(5, np.nan)}},
        {"rows": {"force": np.array(["a"] * 5)}},
        {"ends": [0.5]},
        {"course": [np.zeros((4, 3))] * 2},
        {"course": [np.zeros((3, 3))] * 3},
        {"instant": instant(u=np.zeros((3, 3)))},
        {"instant": instant(time=np.zeros(2))},
        {"last": {False: replace(checkpoint().last[False], motion=np.zeros(5))}},
        {"last": {False: replace(checkpoint().last[False], near=np.zeros((3, 3)))}},
        {"last": {True: replace(checkpoint().last[False], slips=np.zeros((1, NS)))}},
    ],
)
def test_a_checkpoint_that_the_run_cannot_have_written_does_not_fit(
    changes: dict[str, Any],
) -> None:
    assert not of_run(replace(checkpoint(), **changes))
