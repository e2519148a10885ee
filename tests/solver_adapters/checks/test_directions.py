from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from solver_adapters.interface import (
    BadSimulationError,
    Direction,
    Simulation,
)
from tests.solver_adapters.simulations import (
    GOOD,
    NAN,
    N,
    along,
    refused,
)

DIRECTION = Direction("a")

BROKEN: list[tuple[Simulation, str]] = [
    (along(motion=3.0), "motion of direction 'a' is a float; expected an array"),
    (
        replace(GOOD, directions=(DIRECTION, DIRECTION)),
        "two directions have the name 'a'; expected different names",
    ),
    (
        along(material={"tau0": NAN}),
        "direction 'a' changes tau0 by nan; expected a finite number",
    ),
    (
        along(material={"tau0": None}),
        "the change of tau0 in direction 'a' is None; expected a number",
    ),
    (
        along(material={"tau0": "a"}),
        "the change of tau0 in direction 'a' is 'a'; expected a number",
    ),
    (
        along(material={"tau0": 1j}),
        "the change of tau0 in direction 'a' is 1j; expected a number",
    ),
    (
        along(material=["tau0"]),
        "material of direction 'a' is ['tau0']; expected numbers by the names of parameters",
    ),
    (along(scale="a"), "scale of direction 'a' is 'a'; expected a number"),
    (along(scale=None), "scale of direction 'a' is None; expected a number"),
    (
        along(["a"]),
        "a direction has the name ['a']; expected text",
    ),
    (along(scale=0.0), "scale of direction 'a' is 0; expected a positive number"),
    (
        along(rotation=np.zeros((1, 3))),
        "rotation of direction 'a' has shape (1, 3); expected (2, 3)",
    ),
    (
        along(lattice_gradient=np.zeros(2)),
        "lattice_gradient of direction 'a' has shape (2,); expected (2, 3)",
    ),
    (
        along(motion=np.zeros((3, 1, 3))),
        "motion of direction 'a' has shape (3, 1, 3); expected (3, 18, 3)",
    ),
    (
        along(points=np.zeros((1, 3))),
        f"points of direction 'a' has shape (1, 3); expected ({N}, 3)",
    ),
    (
        along(times=np.zeros(2)),
        "times of direction 'a' has shape (2,); expected (3,)",
    ),
    (
        along(times=np.array([0.0, NAN, 1.0])),
        "times of direction 'a' holds 1 values that are not finite; expected finite",
    ),
    (
        along(points=np.full((N, 3), NAN)),
        f"points of direction 'a' holds {3 * N} values that are not finite; expected finite",
    ),
]


@pytest.mark.parametrize(("simulation", "sentence"), BROKEN, ids=[s for _, s in BROKEN])
def test_a_broken_direction_is_named_in_one_sentence(simulation: Simulation, sentence: str) -> None:
    refused(simulation, BadSimulationError, sentence)
