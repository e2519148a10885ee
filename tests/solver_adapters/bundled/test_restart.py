"""What is written down of a run, and what is not taken for it."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import numpy as np

from solver_adapters.bundled.instants import Increment, Instant
from solver_adapters.bundled.law import NS, S_ACC, S_X2
from solver_adapters.bundled.restart import FILE, Checkpoint, read, write


def checkpoint() -> Checkpoint:
    rng = np.random.default_rng(3)
    instant = Instant(
        1.5, rng.random((4, 3)), rng.random((8, 9)), rng.random((8, S_X2)), 7.5,
        rng.random((4, 3, 2)), rng.random((8, 2, S_ACC)), rng.random(2),
    )  # fmt: skip
    last = {False: Increment(rng.random((4, 3)), rng.random((8, NS)), rng.random(6), 0.5)}
    return Checkpoint(3, instant, last, {"force": rng.random(5)}, [0.5, 1.0, 1.5], (3, 9, 1, 0))


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
    np.testing.assert_array_equal(found.rows["force"], written.rows["force"])


def test_no_file_another_key_and_a_damaged_file_are_no_checkpoint(tmp_path: Path) -> None:
    assert read(tmp_path, "key") is None
    write(tmp_path, "key", checkpoint())
    assert read(tmp_path, "other") is None
    whole = (tmp_path / FILE).read_bytes()
    for damaged in (b"", b"no archive", whole[: len(whole) // 2]):
        (tmp_path / FILE).write_bytes(damaged)
        assert read(tmp_path, "key") is None
