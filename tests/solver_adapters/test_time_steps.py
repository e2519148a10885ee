"""Ends of time steps that do not begin at zero: what a solver answers is what another takes."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from meshes.arrays import FloatArray
from solver_adapters.bundled.adapter import BundledAdapter
from solver_adapters.calculix.deck import render_files
from solver_adapters.checks.simulation import refuse_bad_simulation
from solver_adapters.interface import BadSimulationError, Simulation
from solver_adapters.material import Material
from solver_adapters.time_steps import between_instants, step_ends
from tools.boxes import box, pulled

TIMES = np.array([0.7, 2.9, 3.4])
PLAIN = replace(
    pulled(box(), Material(tau0_112=1e9, strain_measure="small"), (0.001, 0.002)),
    times=TIMES,
    integration="backward_euler",
)


def asked(*steps: float) -> Simulation:
    return replace(PLAIN, steps=np.array(steps))


def counted_from_the_start(ends: FloatArray) -> FloatArray:
    """Ends as a program answers that counts from zero."""
    return np.asarray(TIMES[0] + (ends - TIMES[0]))


def test_without_steps_the_intervals_are_divided_and_end_at_the_instants() -> None:
    np.testing.assert_array_equal(step_ends(PLAIN), TIMES)
    ends = step_ends(PLAIN, 4)
    np.testing.assert_allclose(np.diff(ends), [0.55] * 4 + [0.125] * 4)
    assert ends[[0, 4, 8]].tolist() == TIMES.tolist()


def test_a_step_that_ends_beside_an_instant_by_rounding_ends_at_it() -> None:
    steps = counted_from_the_start(np.array([1.0, 2.9, 3.1, 3.4]))
    assert (steps[[1, 3]] != TIMES[1:]).all()
    refuse_bad_simulation(replace(PLAIN, steps=steps))
    assert step_ends(replace(PLAIN, steps=steps)).tolist() == [0.7, 1.0, 2.9, steps[2], 3.4]


def test_an_instant_is_one_end_though_steps_surround_it() -> None:
    assert step_ends(asked(2.9 - 1e-9, 2.9 + 1e-9, 3.4)).tolist() == TIMES.tolist()


def test_no_step_of_a_deck_is_the_rounding_of_an_instant() -> None:
    steps = counted_from_the_start(np.array([1.0, 2.9, 3.1, 3.4]))
    text = render_files(replace(PLAIN, steps=steps))["steps.inp"].decode()
    ends = re.findall(r"^\*\* (\S+) s to (\S+) s$", text, re.M)
    assert ends == [("0.7", "1"), ("1", "2.9"), ("2.9", "3.1"), ("3.1", "3.4")]


@pytest.mark.parametrize(
    ("steps", "first"),
    [((0.2, 2.9, 3.4), "0.2"), ((0.7, 2.9, 3.4), "0.7"), ((2.9, 3.4, 4.0), "4")],
)
def test_steps_outside_of_the_history_are_refused(steps: tuple[float, ...], first: str) -> None:
    with pytest.raises(BadSimulationError) as error:
        refuse_bad_simulation(asked(*steps))
    assert str(error.value) == (
        f"steps holds 1 ends outside of the history, the first is {first} s; expected ends after "
        "0.7 s and up to 3.4 s"
    )


def test_the_motion_is_linear_between_the_instants() -> None:
    values = np.array([[0.0, 0.0], [1.1, 2.2], [1.1, -0.8]])
    np.testing.assert_allclose(between_instants(1.8, TIMES, values), [0.55, 1.1])
    np.testing.assert_allclose(between_instants(3.15, TIMES, values), [1.1, 0.7])
    for instant, value in zip(TIMES, values, strict=True):
        np.testing.assert_array_equal(between_instants(instant, TIMES, values), value)


def test_the_bundled_solver_takes_the_same_steps() -> None:
    steps = counted_from_the_start(np.array([1.0, 2.9, 3.1, 3.4]))
    response = BundledAdapter().solve(replace(PLAIN, steps=steps))
    np.testing.assert_array_equal(response.ends, step_ends(replace(PLAIN, steps=steps))[1:])
