"""What is written down of a run, and what is not taken for it."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from solver_adapters.bundled.instants import Increment, Instant
from solver_adapters.bundled.law import NS, S_ACC, S_X2
from solver_adapters.bundled.restart import FILE, Checkpoint, read, simulation_key, write
from solver_adapters.interface import Direction
from solver_adapters.material import Material
from tests.solver_adapters.boxes import box, pulled

SIMULATION = pulled(box(), Material(), (0.002, 0.004))


def checkpoint() -> Checkpoint:
    rng = np.random.default_rng(3)
    frame = Instant(
        1.5, rng.random((4, 3)), rng.random((8, 9)), rng.random((8, S_X2)), 7.5,
        rng.random((4, 3, 2)), rng.random((8, 2, S_ACC)), rng.random(2),
    )  # fmt: skip
    last = {False: Increment(rng.random((4, 3)), rng.random((8, NS)), rng.random(6), 0.5)}
    return Checkpoint(3, frame, last, {"force": rng.random(5)}, [0.5, 1.0, 1.5], (3, 9, 1, 0))


def test_a_checkpoint_is_read_as_it_was_written(tmp_path: Path) -> None:
    written = checkpoint()
    write(tmp_path, "key", written)
    found = read(tmp_path, "key")
    assert found is not None
    assert (found.index, found.ends, found.counts) == (3, [0.5, 1.0, 1.5], (3, 9, 1, 0))
    for item in fields(Instant):
        np.testing.assert_array_equal(
            getattr(found.frame, item.name), getattr(written.frame, item.name)
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


@pytest.mark.parametrize(
    "change",
    [
        {"material": Material(tau0=40.0 + 1e-12)},
        {"accuracy": 1.0},
        {"integration": "backward_euler"},
        {"motion": SIMULATION.motion + 1e-15},
        {"directions": (Direction("tau0", material={"tau0": 1.0}),)},
        {"lattice_gradient": np.zeros((2, 3))},
    ],
    ids=lambda change: next(iter(change)),
)
def test_the_key_tells_simulations_apart(change: dict[str, object]) -> None:
    key = simulation_key(SIMULATION, "1")
    assert simulation_key(replace(SIMULATION), "1") == key
    assert simulation_key(SIMULATION, "2") != key
    assert simulation_key(replace(SIMULATION, **change), "1") != key  # type: ignore[arg-type]
