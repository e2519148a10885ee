from __future__ import annotations

from dataclasses import replace

import pytest

from solver_adapters.interface import (
    BadSimulationError,
    Simulation,
)
from tests.solver_adapters.simulations import (
    GOOD,
    NAN,
    N,
    at,
    given,
    held,
    refused,
    with_value,
)

ALL_MODES = (
    "translation along X and translation along Y and translation along Z "
    "and rotation about X and rotation about Y and rotation about Z"
)
FREE = "the prescribed motion leaves the specimen free in {}; expected motion_mask to hold all"

BROKEN: list[tuple[Simulation, str]] = [
    (
        replace(GOOD, motion_nodes=GOOD.motion_nodes[:, None]),
        "motion_nodes has shape (18, 1); expected (n,)",
    ),
    (
        replace(GOOD, motion_nodes=with_value(GOOD.motion_nodes, 0, N)),
        f"motion_nodes holds {N}, but there are {N} nodes; expected 0 to {N - 1}",
    ),
    (
        replace(GOOD, motion_nodes=with_value(GOOD.motion_nodes, 1, GOOD.motion_nodes[0])),
        f"1 nodes are prescribed twice in motion_nodes, the first is node {GOOD.motion_nodes[0]}",
    ),
    (
        replace(GOOD, motion_mask=GOOD.motion_mask[:5]),
        "motion_mask has shape (5, 3); expected (18, 3)",
    ),
    (
        given(motion_mask=GOOD.motion_mask * 1.0),
        "motion_mask holds float64; expected true or false",
    ),
    (
        replace(GOOD, motion=GOOD.motion[:2]),
        "motion has shape (2, 18, 3); expected (3, 18, 3)",
    ),
    (
        replace(GOOD, motion=with_value(GOOD.motion, (1, 4), NAN)),
        "motion holds 3 values that are not finite; expected finite numbers",
    ),
    (
        replace(GOOD, motion=GOOD.motion + 0.25),
        "motion is 0.25 µm at the first instant, where the specimen is at rest; expected zero",
    ),
    (held(lambda points: False), FREE.format(ALL_MODES)),
    (
        held(lambda points: [True, True, False]),
        FREE.format("translation along Z"),
    ),
    (
        held(lambda points: [False, True, False]),
        FREE.format("translation along X and translation along Z and rotation about Y"),
    ),
    (
        held(lambda points: at(points, 0, 0, 0)),
        FREE.format("rotation about X and rotation about Y and rotation about Z"),
    ),
    (
        held(lambda points: at(points, 0, 0, 0) | at(points, 0, 4, 0)),
        FREE.format("rotation about Y"),
    ),
    (
        held(lambda points: at(points, 0, 0, 0) | at(points, 2, 4, 0)),
        FREE.format("a rigid motion"),
    ),
]


@pytest.mark.parametrize(("simulation", "sentence"), BROKEN, ids=[s for _, s in BROKEN])
def test_a_motion_that_cannot_be_prescribed_is_named_in_one_sentence(
    simulation: Simulation, sentence: str
) -> None:
    refused(simulation, BadSimulationError, sentence)
