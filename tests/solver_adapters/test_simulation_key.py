"""The key is the same for equal simulations, on every machine, and for no others."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from solver_adapters.interface import Direction, Trajectory
from solver_adapters.material import Material
from solver_adapters.simulation_key import simulation_key
from tools.boxes import box, pulled

SIMULATION = pulled(box(), Material(), (0.002, 0.004))


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
def test_the_key_tells_simulations_apart(change: dict[str, Any]) -> None:
    key = simulation_key(SIMULATION, "1")
    assert simulation_key(replace(SIMULATION), "1") == key
    assert simulation_key(SIMULATION, "2") != key
    assert simulation_key(replace(SIMULATION, **change), "1") != key


def test_the_key_does_not_know_how_the_iterations_begin() -> None:
    key = simulation_key(SIMULATION, "1")
    trajectory = Trajectory(
        SIMULATION.times, np.ones((len(SIMULATION.times), len(SIMULATION.mesh.points), 3))
    )
    assert simulation_key(replace(SIMULATION, warm_start=trajectory), "1") == key


def test_the_key_does_not_know_the_byte_order_nor_the_layout_in_memory() -> None:
    key = simulation_key(SIMULATION, "1")
    big = SIMULATION.motion.astype(">f8")
    assert big.tobytes() != SIMULATION.motion.tobytes()
    assert simulation_key(replace(SIMULATION, motion=big), "1") == key
    turned = np.asfortranarray(SIMULATION.motion)
    assert simulation_key(replace(SIMULATION, motion=turned), "1") == key
    number = replace(SIMULATION, tolerance=np.float64(SIMULATION.tolerance))
    assert simulation_key(number, "1") == key
