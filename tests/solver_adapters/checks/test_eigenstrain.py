from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from meshes.prism_mesh import PrismMesh
from solver_adapters.checks.simulation import refuse_bad_simulation
from solver_adapters.crystal import BCC48
from solver_adapters.interface import (
    UnsupportedError,
)
from solver_adapters.material import Material
from tools.boxes import BOXES, pulled

# Along ⟨001⟩ and ⟨111⟩: 1/E is S11 and (1/3)/(C11 + 2 C12) + 1/(3 C44); the largest Schmid factors
# are √2/3 and √8/9 on {112}, 1/√6 and √(2/27) on {110}.
M = Material()
S11 = (M.C11 + M.C12) / ((M.C11 - M.C12) * (M.C11 + 2 * M.C12))
E111 = 3 / (1 / (M.C11 + 2 * M.C12) + 1 / M.C44)
CUBE = np.eye(3)
ACROSS = np.array([1.0, -1.0, 0.0]) / np.sqrt(2)
DIAGONAL = np.stack([ACROSS, np.ones(3) / np.sqrt(3), np.cross(ACROSS, np.ones(3) / np.sqrt(3))])


@pytest.mark.parametrize("make", BOXES.values(), ids=BOXES)
@pytest.mark.parametrize(
    ("changes", "grain", "stress"),
    [
        ({}, 2, 40 / (np.sqrt(8) / 9)),
        ({"tau0": 20.0}, 2, 20 / (np.sqrt(8) / 9)),
        ({"tau0_grain2": 2.0}, 1, 40 / (np.sqrt(2) / 3)),
        ({"tau0_grain2": 2.0, "tau0_112": 1.3}, 1, 40 * np.sqrt(6)),
        (
            {"tau0_grain2": 2.0, "tau0_112": 1.3, "slip_systems": BCC48, "tau0_123": 0.9},
            1,
            0.9 * 40 * np.sqrt(42) / 3,
        ),
    ],
)
def test_an_eigenstrain_may_stress_a_specimen_up_to_its_yield(
    make: Callable[[], PrismMesh], changes: dict[str, Any], grain: int, stress: float
) -> None:
    """A square section is √12 standard deviations deep: its faces are 1/√6 of √18 of them off."""
    modulus = (1 / S11, E111)[grain - 1]
    bound = stress / modulus * np.sqrt(6)
    material = replace(M, **changes)
    simulation = replace(
        pulled(make(), replace(material, eigenstrain=-0.99 * bound), (0.002,)),
        orientations=np.stack([CUBE, DIAGONAL]),
    )
    refuse_bad_simulation(simulation)
    beyond = replace(simulation, material=replace(material, eigenstrain=2 * bound))
    with pytest.raises(UnsupportedError) as error:
        refuse_bad_simulation(beyond)
    assert str(error.value) == (
        f"eigenstrain is {2 * bound:g}, by which grain {grain} carries about {2 * stress:.3g} MPa "
        f"before loading and yields at {stress:.3g}; expected at most {bound:.2g} in size"
    )
