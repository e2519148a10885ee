"""What was read of a job is held against the motion that its simulation prescribes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from meshes.arrays import FloatArray
from solver_adapters.interface import Response, Simulation
from solver_adapters.jobs.answer import refuse_bad_response
from solver_adapters.material import Material
from solver_adapters.result_files import ResultFileError
from tools.boxes import box, pulled

PULLED = pulled(box(), Material(), (0.0011, 0.0023))


def answer(simulation: Simulation) -> Response:
    """The prescribed motion where there is one, and some other displacement elsewhere."""
    nodes, n = simulation.output_nodes, len(simulation.output)
    displacement = np.full((n, len(nodes), 3), 1e-3)
    for row, node in enumerate(nodes):
        for place in np.flatnonzero(simulation.motion_nodes == node):
            displacement[:, row] = simulation.motion[simulation.output][:, place]
    return Response(displacement, np.zeros(n), np.zeros((0, *displacement.shape)), np.zeros((0, n)))


def six_digits(values: FloatArray) -> FloatArray:
    return np.array([float(f"{v:.5e}") for v in values.ravel()]).reshape(values.shape)


def test_the_prescribed_motion_in_six_digits_is_that_motion() -> None:
    rng = np.random.default_rng(2)
    motion = PULLED.motion * (1 + 1e-3 * rng.random(PULLED.motion.shape))
    found = answer(replace(PULLED, motion=motion))
    rounded = replace(found, displacement=six_digits(found.displacement))
    assert (rounded.displacement != found.displacement).any()
    refuse_bad_response(replace(PULLED, motion=motion), rounded)


def test_a_motion_that_differs_in_the_fourth_digit_is_another_one() -> None:
    """A step of finite differences along a motion is a few ten thousandths of it."""
    other = replace(PULLED, motion=1.0002 * PULLED.motion)
    with pytest.raises(ResultFileError, match=r"along Y at node \d+, expected 0.0092 µm as presc"):
        refuse_bad_response(PULLED, answer(other))


def test_outputs_in_any_order_are_compared_node_by_node() -> None:
    nodes = np.array([*PULLED.motion_nodes[[5, 1, -2]], 0, 26])
    asked = replace(PULLED, output=np.array([0, 2]), output_nodes=np.unique(nodes)[::-1])
    refuse_bad_response(asked, answer(asked))
    with pytest.raises(ResultFileError, match="as prescribed"):
        refuse_bad_response(asked, answer(replace(asked, motion=asked.motion[::-1])))


def test_components_that_are_not_prescribed_may_be_anything() -> None:
    free = PULLED.motion_mask.copy()
    free[:, 0] = False
    motion = PULLED.motion.copy()
    motion[..., 0] = np.nan
    moved = answer(PULLED)
    moved.displacement[..., 0] += 0.5
    refuse_bad_response(replace(PULLED, motion_mask=free, motion=motion), moved)
    with pytest.raises(ResultFileError, match="along X"):
        refuse_bad_response(PULLED, moved)


def test_no_wanted_node_is_compared_with_nothing() -> None:
    none = replace(PULLED, output_nodes=np.arange(0))
    refuse_bad_response(none, answer(none))


def test_steps_that_pass_over_an_instant_are_those_of_a_listing_that_is_not_whole() -> None:
    first, last = PULLED.times[1:]
    whole = replace(answer(PULLED), ends=np.array([0.5 * first, first, last * (1 + 1e-7)]))
    refuse_bad_response(PULLED, whole)
    for ends in ([0.5 * first, first], [0.4 * last, last]):
        with pytest.raises(ResultFileError, match="time steps up to .* the listing of the run is"):
            refuse_bad_response(PULLED, replace(whole, ends=np.array(ends)))
    # A program that tells no steps.
    refuse_bad_response(PULLED, answer(PULLED))
