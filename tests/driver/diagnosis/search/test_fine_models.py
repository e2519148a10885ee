from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from driver.diagnosis.causes.ebsd_flips import FLIPS
from driver.diagnosis.search.fine_models import FineModels, added_by_second
from driver.diagnosis.search.refit import Executor
from driver.forward.model import ForwardModel
from driver.identification.correction import SecondMesh, correction
from driver.identification.fit import Fit
from driver.identification.step_error import StepError
from meshes.arrays import FloatArray
from solver_adapters.interface import PreparedError, Response, Simulation, SolverError
from tools import closed_form
from tools.closed_form_diagnosis import finer, identified

BENCH = closed_form.problem()
OBJECTIVE = closed_form.objective(BENCH, BENCH.truth)
ONE, SECOND = finer(BENCH, 0.001), finer(BENCH, 0.003)


@cache
def here() -> Fit:
    return identified(BENCH, closed_form.objective(BENCH, BENCH.truth))[1]


class Never(closed_form.ClosedFormSolver):
    """The finer mesh, which is not simulated again."""

    def answer(self, simulation: Simulation) -> tuple[FloatArray, FloatArray]:
        raise AssertionError("was simulated")


def raising(error: Exception) -> Callable[[], ForwardModel]:
    def make() -> ForwardModel:
        raise error

    return make


def test_two_meshes_give_the_difference_of_the_first_and_half_of_what_the_other_adds() -> None:
    first, second = FineModels(ONE, lambda: SECOND).corrections(
        OBJECTIVE, here(), True, Executor(1, 1)
    )
    working, one, other = (m.predict(here().values) for m in (BENCH.model, ONE, SECOND))
    assert second is not None and not second.is_better
    half = second.added
    assert first.motion == pytest.approx(one.motion - working.motion, abs=1e-12)
    assert first.load == pytest.approx(one.load - working.load, abs=1e-9)
    assert half.motion == pytest.approx(0.5 * (other.motion - one.motion), abs=1e-12)
    assert half.load == pytest.approx(0.5 * (other.load - one.load), abs=1e-9)
    assert np.abs(half.load).max() > 0.1  # µN: there is a difference
    both = first.with_second(second)
    mean = 0.5 * (one.load + other.load)
    assert both.load == pytest.approx(mean - working.load, abs=1e-9)


def test_both_meshes_are_simulated_side_by_side_with_the_same_numbers_and_words(
    lines: list[str],
) -> None:
    meshes, at = FineModels(ONE, lambda: SECOND), here()
    lines.clear()
    first, half = meshes.corrections(OBJECTIVE, at, True, Executor(1, 1))
    told = lines.copy()
    same, as_much = meshes.corrections(OBJECTIVE, at, True, Executor(2, 1))
    assert half is not None and as_much is not None
    for one, other in ((first, same), (half.added, as_much.added)):
        np.testing.assert_array_equal(one.motion, other.motion)
        np.testing.assert_array_equal(one.load, other.load)
    values = {n: 1.02 * v for n, v in at.values.items()}
    for wanted, found in zip(first.at(values).of_mesh, same.at(values).of_mesh, strict=True):
        np.testing.assert_array_equal(found, wanted)
    assert told[-2] == "the same on a second mesh" and lines == 2 * told


def test_what_the_second_mesh_adds_is_told_without_the_first_one_again() -> None:
    baseline, free = here(), here().best.free
    away = {n: 1.02 * v if n == "tau0" else v for n, v in baseline.values.items()}
    taken = correction(BENCH.model, ONE, BENCH.model.predict(away, free), away, free=free)
    meshes = FineModels(replace(ONE, adapter=Never()), lambda: SECOND)
    half = meshes.second(replace(OBJECTIVE, correction=taken), baseline)
    _, wanted = FineModels(ONE, lambda: SECOND).corrections(
        OBJECTIVE, baseline, True, Executor(1, 1)
    )
    assert half is not None and wanted is not None
    constant = 0.5 * np.abs(taken.load - taken.at(baseline.values).load).max()
    assert np.abs(half.added.load - wanted.added.load).max() < 0.1 * constant


def test_what_steps_of_first_order_change_is_no_difference_of_the_meshes() -> None:
    """They change the correction by either mesh alike, but from fit to fit."""
    baseline, meshes = here(), FineModels(ONE, lambda: SECOND)
    values = baseline.values
    taken = correction(BENCH.model, ONE, baseline.best.prediction, values)
    left = StepError(0.1 * np.asarray(taken.motion), np.full(np.shape(taken.load), 3.0))
    stepped = replace(taken.plus(left.motion, left.load), left_by_steps=left, parts=2)
    plain, found = (
        meshes.second(replace(OBJECTIVE, correction=one), baseline) for one in (taken, stepped)
    )
    assert plain is not None and found is not None
    np.testing.assert_allclose(found.added.load, plain.added.load, atol=1e-9)
    np.testing.assert_allclose(found.added.motion, plain.added.motion, atol=1e-12)


class OfFirstOrder(closed_form.ClosedFormSolver):
    """A solver whose steps make the load too large by as much as they are long."""

    def __init__(self, finer: float = 0.0) -> None:
        super().__init__(finer)
        self.runs = 0

    def solve(self, simulation: Simulation, *rest: Any, **more: Any) -> Response:
        self.runs += 1
        answer = super().solve(simulation, *rest, **more)
        ends = simulation.times[1:] if simulation.steps is None else simulation.steps
        return replace(answer, ends=ends, force=(1.0 + 0.5 / ends.size) * answer.force)


def test_what_steps_of_first_order_leave_is_not_simulated_again_for_a_second_mesh() -> None:
    adapter, values = OfFirstOrder(), here().values
    working = replace(BENCH.model, adapter=adapter, integration="backward_euler")
    one, second = (
        replace(working, adapter=OfFirstOrder(by), steps_per_interval=2) for by in (0.001, 0.003)
    )
    coarse = working.predict(values)
    at = replace(here(), best=replace(here().best, prediction=coarse))
    first, other = (correction(working, finest, coarse, values) for finest in (one, second))
    assert first.left_by_steps is not None and np.abs(first.left_by_steps.load).max() > 0.1
    adapter.runs = 0
    objective = replace(OBJECTIVE, model=working, correction=first)
    found = added_by_second(second, None, objective, at)
    assert adapter.runs == 0
    # The first mesh of two tells what steps leave.
    FineModels(one, lambda: second).corrections(objective, at, True, Executor(1, 1))
    assert adapter.runs == 1
    assert isinstance(found, SecondMesh)
    (motion, load), (first_motion, first_load) = other.of_mesh, first.of_mesh
    np.testing.assert_allclose(found.difference.load, load - first_load, atol=1e-9)
    np.testing.assert_allclose(found.difference.motion, motion - first_motion, atol=1e-12)
    assert np.abs(found.difference.load).max() > 0.1


def test_what_the_second_mesh_added_before_is_no_part_of_the_first_one() -> None:
    meshes = FineModels(ONE, lambda: SECOND)
    change, second = meshes.corrections(OBJECTIVE, here(), True, Executor(1, 1))
    assert second is not None
    whole = replace(OBJECTIVE, correction=change.with_second(second), second=second)
    again = meshes.second(whole, here())
    assert again is not None
    np.testing.assert_allclose(again.difference.load, second.difference.load, atol=1e-9)
    np.testing.assert_allclose(again.difference.motion, second.difference.motion, atol=1e-12)
    assert np.abs(second.difference.motion).max() > 1e-6


def test_the_second_mesh_is_made_where_it_is_asked_for_alone() -> None:
    unwanted = FineModels(ONE, raising(AssertionError("was made")))
    assert unwanted.corrections(OBJECTIVE, here(), False, Executor(1, 1))[1] is None
    assert FineModels(ONE).corrections(OBJECTIVE, here(), True, Executor(1, 1))[1] is None


def test_where_the_second_mesh_cannot_be_simulated_one_has_to_do_and_that_is_told(
    lines: list[str],
) -> None:
    meshes = FineModels(ONE, raising(SolverError("no step is short enough\nin 7 tries")))
    assert meshes.corrections(OBJECTIVE, here(), True, Executor(1, 1))[1] is None
    assert lines[-1] == "  one mesh has to do: no step is short enough"


def test_a_job_that_was_only_prepared_is_not_done_without() -> None:
    with pytest.raises(PreparedError):
        FineModels(ONE, raising(PreparedError([Path("key")]))).corrections(
            OBJECTIVE, here(), True, Executor(1, 1)
        )


def test_a_flip_of_the_ebsd_frame_turns_the_grains_of_both_meshes() -> None:
    meshes = FineModels(ONE, lambda: SECOND).turned((FLIPS[0],))
    assert meshes.make_second is not None
    one, other, measured = (
        model.simulation(BENCH.truth).orientations
        for model in (meshes.one, meshes.make_second(), ONE)
    )
    assert not np.allclose(one, measured) and np.array_equal(one, other)


def test_a_second_mesh_of_better_cells_is_told_as_that_and_stays_it_for_turned_grains() -> None:
    meshes = FineModels(ONE, lambda: SECOND, 0.667)
    _, alike = FineModels(ONE, lambda: SECOND).corrections(OBJECTIVE, here(), True, Executor(1, 1))
    _, better = meshes.corrections(OBJECTIVE, here(), True, Executor(1, 1))
    assert alike is not None and better is not None
    assert alike.size is None and better.size == 0.667 == meshes.turned((FLIPS[0],)).size
    np.testing.assert_array_equal(better.difference.load, alike.difference.load)
    np.testing.assert_array_equal(better.added.load, 2.0 * np.asarray(alike.added.load))
