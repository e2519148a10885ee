"""The error of time steps of first order, by halves of those that were taken."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.short_specimen import small_case
from driver.identification.procedure import correction, errors_of
from driver.identification.step_error import has_first_order, in_parts_of, parts_of, step_error
from driver.log import silent
from driver.model import ForwardModel
from driver.prediction import Prediction
from driver.specimen import build_model, mesh_of
from driver.virtual_course import stage_program
from solver_adapters.bundled.adapter import BundledAdapter

CASE = small_case()
HISTORY = stage_program([(4, 1)])


def model(steps: int = 1, scheme: str = "backward_euler") -> ForwardModel:
    """A coarse one, without pixels."""
    solver = CASE.solver.model_copy(update={"integration": scheme})
    case = CASE.model_copy(update={"solver": solver})
    pixels = np.array([[0.0, 2.0], [0.5, 6.0]])
    return build_model(case, mesh_of(CASE, 4.0), HISTORY, pixels, BundledAdapter(), steps)


def values() -> dict[str, float]:
    return model().null_values() | {"elongation_1": 0.045, "elongation_2": 0.040, "tau0": 25.0}


class At:
    """A fit that has ended at some values, as far as a correction asks for it."""

    def __init__(self, prediction: Prediction, values: Mapping[str, float]) -> None:
        self.values = values
        self.best = type("Best", (), {"prediction": prediction})


def test_halved_steps_tell_the_error_against_the_limit_of_small_ones() -> None:
    working = model(4)
    coarse, limit = working.predict(values()), model(128).predict(values())
    found = step_error(working, coarse, values())
    for mine, true in (
        (found.load, limit.load - coarse.load),
        (found.motion, limit.motion - coarse.motion),
    ):
        assert np.linalg.norm(mine - true) < 0.3 * np.linalg.norm(true)


def test_the_steps_that_were_taken_are_divided_those_that_were_cut_too() -> None:
    cut = np.sort(np.append(HISTORY.time[1:], [HISTORY.time[2] - 1.0, HISTORY.time[2] - 0.5]))
    working = replace(model(), steps=cut)
    coarse = working.predict(values())
    np.testing.assert_allclose(coarse.response.ends, cut)
    parts = in_parts_of(working, coarse, values(), 2).predict(values()).response.ends
    assert parts.size == 2 * cut.size
    np.testing.assert_allclose(parts[1::2], cut)
    np.testing.assert_allclose(parts[::2], 0.5 * (np.append(0.0, cut[:-1]) + cut))


@pytest.mark.parametrize(("fine", "parts"), [(1, 1), (2, 2), (3, 3)])
def test_of_a_finer_simulation_on_the_same_mesh_all_is_of_the_steps(fine: int, parts: int) -> None:
    working, finer = model(), model(fine)
    assert parts_of(working, finer) == parts
    coarse = working.predict(values())
    change = correction(working, finer, At(coarse, values()), silent)  # type: ignore[arg-type]
    error = step_error(working, coarse, values())
    np.testing.assert_allclose(change.steps_load, error.load / parts)
    (_, mesh), (_, steps) = errors_of(change)
    if parts <= 2:
        # By construction: halves are what both are made of.
        np.testing.assert_allclose(mesh, 0.0, atol=1e-6 * abs(error.load).max())
    assert np.linalg.norm(mesh) < 0.2 * np.linalg.norm(error.load)
    np.testing.assert_array_equal(steps, change.steps_load)


def test_a_finer_simulation_takes_the_steps_that_were_cut_in_parts() -> None:
    """Else its correction would compare steps of the one with other steps of the other."""
    cut = np.sort(np.append(HISTORY.time[1:], HISTORY.time[2] - 1.0))
    working = replace(model(), steps=cut)
    coarse = working.predict(values())
    finer = in_parts_of(model(2), coarse, values(), 2)
    assert finer.predict(values()).response.ends.size == 2 * cut.size


def test_another_scheme_or_another_bound_of_the_error_is_left_alone() -> None:
    exponential = model(scheme="exponential")
    coarse = exponential.predict(values())
    assert not has_first_order(exponential, coarse)
    assert has_first_order(model(), coarse)
    assert not has_first_order(replace(model(), accuracy=1.0), coarse)
    change = correction(exponential, model(2, "exponential"), At(coarse, values()), silent)  # type: ignore[arg-type]
    assert change.steps_load == 0.0 and change.steps_share == 0.0
    (_, mesh), (_, steps) = errors_of(change)
    np.testing.assert_array_equal(mesh, change.load)
    assert not steps.any()
