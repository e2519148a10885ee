"""A good simulation of 12 cells, and what can be broken in it."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from meshes.arrays import FloatArray
from solver_adapters.checks.simulation import refuse_bad_simulation
from solver_adapters.interface import Direction, Simulation
from solver_adapters.material import Material
from tools.boxes import box, pulled

GOOD = pulled(box(), Material(), (0.002, 0.004))
MESH = GOOD.mesh
N = len(MESH.points)
NAN, INF = float("nan"), float("inf")


def with_value(array: Any, index: Any, value: Any) -> Any:
    changed = np.array(array)
    changed[index] = value
    return changed


def given(**changes: Any) -> Simulation:
    """The good simulation with fields of any type, as who does not check types may give them."""
    return replace(GOOD, **changes)


def of_mesh(**changes: Any) -> Simulation:
    return replace(GOOD, mesh=replace(MESH, **changes))


def of_material(**changes: Any) -> Simulation:
    return replace(GOOD, material=replace(Material(), **changes))


def along(name: Any = "a", **changes: Any) -> Simulation:
    return replace(GOOD, directions=(Direction(name, **changes),))


def held(holds: Callable[[FloatArray], Any]) -> Simulation:
    """The good simulation with a mask that is made from the positions of the moved nodes."""
    mask = np.zeros(GOOD.motion_mask.shape, dtype=np.bool_)
    mask[:] = holds(MESH.points[GOOD.motion_nodes])
    return replace(GOOD, motion_mask=mask)


def at(points: FloatArray, *place: float) -> Any:
    return (points == np.array(place)).all(axis=1, keepdims=True)


def refused(simulation: Simulation, error: type[Exception], sentence: str) -> None:
    """Hold the refusal of a simulation against the beginning of its sentence."""
    with pytest.raises(error, match=f"^{re.escape(sentence)}") as found:
        refuse_bad_simulation(simulation)
    assert "\n" not in str(found.value)
