"""A cause is seen under the correction where it stands, and its refit begins by that."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from driver.common.outcomes import Failure
from driver.common.progress import collected_lines
from driver.diagnosis.answer.result_types import Refit
from driver.diagnosis.search import corrected_looks
from driver.diagnosis.search.candidate_correction import corrected_refit
from driver.diagnosis.search.corrected_looks import refit_from_look, seen_corrected
from driver.diagnosis.search.looks import Side, Task, seen_at
from driver.diagnosis.search.refit import Executor, Start, with_prior
from driver.identification.correction import Correction, SecondMesh, correction
from driver.identification.objective import Objective
from driver.identification.step_error import StepError
from meshes.arrays import FloatArray
from solver_adapters.interface import Simulation, SolverError
from tests.driver.diagnosis.search.examined import Examined, finer_of, score_of, scored
from tools.closed_form import ClosedFormSolver

TRUTH = 0.6  # six prior scales of a contrast


class Coarse(ClosedFormSolver):
    """A solver whose cells make less of a contrast the larger it is, until they are finer."""

    def answer(self, simulation: Simulation) -> tuple[FloatArray, FloatArray]:
        m = simulation.material
        if not self.finer:
            amount = float(np.log(m.tau0_grain2))
            m = replace(m, tau0_grain2=float(np.exp(amount / (1.0 + 4.0 * amount**2))))
        return super().answer(replace(simulation, material=m))


@pytest.fixture(scope="module")
def hidden() -> Examined:
    return scored({"tau0_grain2": float(np.exp(TRUTH))}, ("grain_contrast", "cold_work"), Coarse)


def begun(hidden: Examined, far: float = 0.3) -> tuple[Task, Objective, Side]:
    """A look three prior scales off the null, or farther, as the working mesh shows it."""
    near = score_of(hidden.scores, "grain_contrast")
    task = Task(near, hidden.fit, hidden.objective, finer_of(hidden), 10, 1.0, 1.0)
    extended = with_prior(hidden.objective, near.cause)
    values = hidden.fit.values | {"tau0_grain2": float(np.exp(far))}
    at = extended.compare(extended.model.predict(values), values, ())
    return task, extended, seen_at(task, at, 10.0 * far)


def test_what_cells_make_smaller_is_seen_as_large_as_it_is(hidden: Examined) -> None:
    task, extended, raw = begun(hidden)
    other, side = seen_corrected(task, extended, [raw, raw], [1], "tau0_grain2")
    assert other is raw and side.is_corrected and side.amount == raw.amount
    # Of 0.3 the cells make 0.22.
    assert side.score.estimate / raw.score.estimate == pytest.approx(0.22 / 0.3, abs=0.05)


def test_what_a_second_mesh_adds_is_in_the_correction_of_a_look(hidden: Examined) -> None:
    task, extended, raw = begun(hidden)
    known = extended.correction
    added = Correction(0.0 * np.asarray(known.motion), 3.0 + 0.0 * np.asarray(known.load))
    second = SecondMesh(added, 0.5)
    both = replace(extended, correction=known.with_second(second), second=second)
    loads = []
    for objective in (extended, both):
        (side,) = seen_corrected(task, objective, [raw], [0], "tau0_grain2")
        assert side.correction is not None
        loads.append(np.asarray(side.correction.load))
    np.testing.assert_allclose(loads[1] - loads[0], 3.0, rtol=1e-9)


@pytest.mark.parametrize("cut", [0, 1])
def test_what_time_steps_leave_is_that_at_the_fit_unless_others_were_cut(
    hidden: Examined, monkeypatch: pytest.MonkeyPatch, cut: int
) -> None:
    task, extended, raw = begun(hidden)
    left = StepError(np.zeros((1, 1, 3)), np.zeros(1))
    objective = replace(extended, correction=replace(extended.correction, left_by_steps=left))
    response = raw.at.prediction.response
    response = replace(response, ends=np.append(response.ends, np.arange(float(cut))))
    at = replace(raw.at, prediction=replace(raw.at.prediction, response=response))
    taken_over: list[StepError | None] = []

    def note(*_: Any, left_by_steps: StepError | None, **__: Any) -> Correction:
        taken_over.append(left_by_steps)
        raise SolverError("no more is asked")

    monkeypatch.setattr(corrected_looks, "correction", note)
    seen_corrected(task, objective, [replace(raw, at=at)], [0], "tau0_grain2")
    assert taken_over == [None if cut else left]


def seen(hidden: Examined, far: float = 0.3) -> tuple[Task, Objective, Side]:
    """The look under the correction there."""
    task, extended, raw = begun(hidden, far)
    (side,) = seen_corrected(task, extended, [raw], [0], "tau0_grain2")
    return task, extended, side


def test_a_refit_from_a_look_is_on_the_way_to_where_the_finer_model_would_end(
    hidden: Examined,
) -> None:
    """The cells make no more than 0.25 of any contrast: none of theirs is that of the data."""
    task, extended, side = seen(hidden)
    refit = refit_from_look(task, extended, side)
    assert refit is not None and refit.corrected == "at its end"
    assert 0.5 < np.log(refit.fit.values["tau0_grain2"]) < TRUTH
    # Those that lead are corrected on.
    for _ in range(2):
        after = corrected_refit(refit, task.finer, hidden.fit.best, 8)
        assert not isinstance(after, Failure)
        refit = after
    assert np.log(refit.fit.values["tau0_grain2"]) == pytest.approx(TRUTH, abs=0.05)


@pytest.mark.parametrize("places", [(), (0.5,)])
def test_refits_from_looks_take_over_what_time_steps_leave_at_the_fit(
    hidden: Examined, monkeypatch: pytest.MonkeyPatch, places: tuple[float, ...]
) -> None:
    """Those of what bends do, and those of what lies somewhere."""
    task, extended, side = seen(hidden)
    cause = replace(task.near.cause, places=places)
    task = replace(task, near=replace(task.near, cause=cause))
    left = StepError(np.zeros((1, 1, 3)), np.zeros(1))
    objective = replace(extended, correction=replace(extended.correction, left_by_steps=left))
    asked: list[StepError | None] = []

    def note(*given: Any) -> Failure:
        asked.append(given[4])
        return Failure("no more is asked")

    monkeypatch.setattr(corrected_looks, "corrected_refit", note)
    refit_from_look(task, objective, side)
    assert asked == [left]


def test_a_refit_of_what_bends_has_the_correction_where_it_ends(hidden: Examined) -> None:
    task, extended, side = seen(hidden)
    refit = refit_from_look(task, extended, side)
    assert refit is not None
    values, model = refit.fit.values, extended.model
    there = correction(model, task.finer, model.predict(values), values)
    off = [
        np.abs(there.load - one.at(values).load).max()
        for one in (refit.objective.correction, extended.correction)
    ]
    assert off[0] < 0.2 * off[1]


def test_a_refit_of_what_bends_begins_under_the_correction_that_is_known_at_its_null_and_the_look(
    hidden: Examined, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It stays there where its end cannot be simulated on the finer mesh."""
    task, extended, side = seen(hidden, 0.7)
    assert side.correction is not None
    monkeypatch.setattr(corrected_looks, "corrected_refit", lambda *_: Failure("no solution"))
    with collected_lines() as lines:
        refit = refit_from_look(task, extended, side)
    assert lines[-1] == "  grain_contrast: no further correction, for that failed (no solution)"
    assert refit is not None and refit.corrected == "at a look"
    for at, known in ((hidden.fit.values, extended.correction), (side.at.values, side.correction)):
        change = refit.objective.correction.at(at)
        np.testing.assert_allclose(change.load, known.load, rtol=1e-9)
        np.testing.assert_allclose(change.motion, known.motion, atol=1e-12)


@pytest.mark.parametrize(
    ("end", "straight"), [(7.1, False), (6.9, True), (0.1, True), (-0.1, False)]
)
def test_a_refit_that_does_not_end_between_null_and_look_begins_under_the_correction_there(
    hidden: Examined, monkeypatch: pytest.MonkeyPatch, end: float, straight: bool
) -> None:
    """What goes straight is known between both alone."""
    begun: list[Correction] = []

    def note(refit: Refit, *rest: Any) -> Failure:
        begun.append(refit.objective.correction)
        return Failure("no more is asked")

    monkeypatch.setattr(corrected_looks, "amounts_of", lambda *_: np.array([end]))
    monkeypatch.setattr(corrected_looks, "corrected_refit", note)
    refit_from_look(*seen(hidden, 0.7))
    assert [change.secant is not None for change in begun] == [straight]


def test_a_refit_of_what_bends_begins_no_farther_than_it_was_seen(
    hidden: Examined, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A secant may promise ten prior scales, where no simulation ends."""
    task, extended, side = seen(hidden)
    starts: list[float] = []

    def note(tasks: Sequence[Start], executor: Executor) -> list[Refit]:
        starts.extend(float(np.log(task.values["tau0_grain2"])) for task in tasks)
        return []

    monkeypatch.setattr(corrected_looks, "refit_from", note)
    monkeypatch.setattr(corrected_looks, "corrected_refit", lambda *_: Failure("no solution"))
    for estimate in (10.0, 2.0):
        far = replace(side, score=replace(side.score, estimate=np.array([estimate])))
        assert refit_from_look(task, extended, far) is None
    assert starts == pytest.approx([0.3, 0.2])


def lying_somewhere(task: Task) -> Task:
    """The same with a cause that has a place."""
    near = task.near
    return replace(task, near=replace(near, cause=replace(near.cause, places=(0.5,))))


def test_a_refit_of_what_lies_somewhere_begins_no_farther_than_seven_prior_scales(
    hidden: Examined, monkeypatch: pytest.MonkeyPatch
) -> None:
    task, extended, side = seen(hidden)
    starts: list[float] = []

    def note(refit: Refit, *rest: Any) -> Failure:
        starts.append(float(np.log(refit.fit.values["tau0_grain2"])))
        return Failure("no more is asked")

    monkeypatch.setattr(corrected_looks, "corrected_refit", note)
    for estimate in (10.0, 6.0):
        far = replace(side, score=replace(side.score, estimate=np.array([estimate])))
        assert refit_from_look(lying_somewhere(task), extended, far) is None
    assert starts == pytest.approx([0.7, 0.6])


def test_a_refit_goes_on_under_the_correction_at_its_end_until_the_evidence_settles(
    hidden: Examined, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The third correction changes it by less than 1."""
    task, extended, side = seen(hidden)
    course = [10.0, 12.0, 12.9, 20.0]

    def corrected(refit: Refit, *rest: Any) -> Refit:
        return replace(refit, log_evidence=course.pop(0))

    monkeypatch.setattr(corrected_looks, "corrected_refit", corrected)
    refit = refit_from_look(lying_somewhere(task), extended, side)
    assert refit is not None and refit.log_evidence == 12.9
    assert course == [20.0]


def test_a_look_that_cannot_be_simulated_finer_stays_as_it_was_seen(
    hidden: Examined, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: Any, **__: Any) -> Correction:
        raise SolverError("no solution")

    task, extended, raw = begun(hidden)
    monkeypatch.setattr(corrected_looks, "correction", fails)
    with collected_lines() as lines:
        assert seen_corrected(task, extended, [raw], [0], "tau0_grain2") == [raw]
    assert lines == ["  tau0_grain2 = 1.35 cannot be simulated finer (no solution)"]


def test_a_start_that_cannot_be_simulated_is_told_and_given_up(
    hidden: Examined, monkeypatch: pytest.MonkeyPatch
) -> None:
    task, extended, side = seen(hidden)

    def fails(*_: Any, **__: Any) -> None:
        raise SolverError("no solution")

    monkeypatch.setattr(Objective, "evaluate", fails)
    with collected_lines() as lines:
        assert refit_from_look(task, extended, side) is None
    assert lines[-1] == "  grain_contrast: given up, for it cannot be simulated (no solution)"
