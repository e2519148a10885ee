"""Directions that follow from others: the same derivatives from fewer."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from solver_adapters.bundled.adapter import BundledAdapter
from solver_adapters.bundled.direction_reduction import reduced_directions
from solver_adapters.interface import Direction, Simulation
from solver_adapters.material import Material, StrainMeasure
from tools.boxes import box, pulled

HISTORY = (0.002, 0.004)
RNG = np.random.default_rng(11)
TURNS = tuple(Direction(f"turn {k}", rotation=RNG.normal(size=(2, 3))) for k in range(8))
CONSTANTS = (Direction("tau0", material={"tau0": 1.0}), Direction("b", material={"b": 1.0}))


def simulation(measure: StrainMeasure, *directions: Direction) -> Simulation:
    material = Material(strain_measure=measure)
    return replace(pulled(box(), material, HISTORY), directions=directions)


def test_many_turns_have_the_derivatives_that_each_has_alone(measure: StrainMeasure) -> None:
    asked = (CONSTANTS[0], *TURNS[:4], CONSTANTS[1], *TURNS[4:])
    whole = BundledAdapter().solve(simulation(measure, *asked))
    assert whole.d_force.shape[0] == len(asked)
    for name in ("d_force", "d_displacement"):
        found = getattr(whole, name)
        for row, direction in enumerate(asked):
            alone = getattr(BundledAdapter().solve(simulation(measure, direction)), name)[0]
            np.testing.assert_allclose(
                found[row], alone, rtol=0, atol=1e-9 * abs(found).max(), err_msg=direction.name
            )


def test_no_more_turns_are_carried_than_grains_have_axes() -> None:
    assert len(reduced_directions(simulation("small", *TURNS[:6])).simulation.directions) == 6
    fewer = reduced_directions(simulation("small", *TURNS, CONSTANTS[0]))
    assert [d.name for d in fewer.simulation.directions][0] == "tau0"
    assert len(fewer.simulation.directions) == 7
    tilted = replace(TURNS[0], material={"tau0": 1.0})
    assert (
        len(reduced_directions(simulation("small", tilted, *TURNS[1:])).simulation.directions) == 7
    )


@pytest.mark.parametrize(
    ("idle", "active"),
    [
        ("b", {"Q": 1.0}), ("b", {"Q_latent": 1.0}), ("h_latent", {"Q": 1.0}),
        ("d2", {"c2": 10.0}), ("skin_thickness", {"skin_tau0": 1.1}),
        ("tau0_grain1_band_middle", {"tau0_grain1_band": 0.1}),
        ("tau0_grain2_band_half_width", {"tau0_grain2_band": 0.1}),
    ],
)  # fmt: skip
def test_a_constant_without_effect_is_not_carried(idle: str, active: dict[str, Any]) -> None:
    asked = simulation("small", Direction(idle, material={idle: 1.0}), CONSTANTS[0])
    fewer = reduced_directions(asked)
    assert [d.name for d in fewer.simulation.directions] == ["tau0"]
    response = BundledAdapter().solve(asked)
    assert not response.d_force[0].any() and response.d_force[1].any()
    assert not response.d_displacement[0].any()
    at_work = replace(asked, material=replace(asked.material, **active))
    assert len(reduced_directions(at_work).simulation.directions) == 2
    assert BundledAdapter().solve(at_work).d_force[0].any()
