"""Refusal of directions that do not fit their simulation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from solver_adapters.checks.arrays import expect_finite, expect_number, expect_shape
from solver_adapters.grain_scalars import later_names
from solver_adapters.interface import BadSimulationError, Direction, Simulation, UnsupportedError
from solver_adapters.material import MATERIAL_PARAMETERS


def refuse_bad_directions(simulation: Simulation) -> None:
    """Raise where a direction does not fit its simulation, in one sentence.

    Raises:
        UnsupportedError: a direction along what the material does not have.
        BadSimulationError: names, shapes or numbers that are wrong.
    """
    names: set[str] = set()
    n_grains = simulation.mesh.n_grains
    grains, scalars = (
        (n_grains, 3),
        (*MATERIAL_PARAMETERS, *later_names(n_grains)),
    )
    shapes: dict[str, tuple[int, ...]] = {
        "rotation": grains,
        "lattice_gradient": grains,
        "motion": simulation.motion.shape,
        "points": simulation.mesh.points.shape,
        "times": simulation.times.shape,
    }
    for direction in simulation.directions:
        if not isinstance(direction.name, str):
            raise BadSimulationError(f"a direction has the name {direction.name!r}; expected text")
        if direction.name in names:
            raise BadSimulationError(
                f"two directions have the name {direction.name!r}; expected different names"
            )
        names.add(direction.name)
        _refuse_bad_direction(direction, shapes, scalars)


def _refuse_bad_direction(
    direction: Direction, shapes: dict[str, tuple[int, ...]], scalars: Sequence[str]
) -> None:
    expect_number(f"scale of direction {direction.name!r}", direction.scale)
    if not 0 < direction.scale < np.inf:
        raise BadSimulationError(
            f"scale of direction {direction.name!r} is {direction.scale:g}; "
            "expected a positive number"
        )
    if not isinstance(direction.material, Mapping):
        raise BadSimulationError(
            f"material of direction {direction.name!r} is {direction.material!r}; expected "
            "numbers by the names of parameters"
        )
    for name, rate in direction.material.items():
        if name not in scalars:
            raise UnsupportedError(
                f"direction {direction.name!r} changes {name!r}, which the material does not have; "
                f"expected one of {', '.join(scalars)}"
            )
        expect_number(f"the change of {name} in direction {direction.name!r}", rate)
        if not np.isfinite(rate):
            raise BadSimulationError(
                f"direction {direction.name!r} changes {name} by {rate:g}; expected a finite number"
            )
    for name, shape in shapes.items():
        change = getattr(direction, name)
        if change is not None:
            expect_shape(f"{name} of direction {direction.name!r}", change, shape)
            expect_finite(f"{name} of direction {direction.name!r}", change)
