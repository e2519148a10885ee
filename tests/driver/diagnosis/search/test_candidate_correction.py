from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from driver.common.outcomes import Failure
from driver.diagnosis.answer.result_types import Refit
from driver.diagnosis.search import candidate_correction
from driver.diagnosis.search.candidate_correction import (
    REACH,
    REACH_OF_LARGE,
    corrected_refit,
    with_candidate_corrections,
)
from driver.diagnosis.search.fine_models import FineModels
from driver.diagnosis.search.refit import Executor, refit_causes
from driver.diagnosis.statistics.score_test import score
from driver.diagnosis.statistics.screening import screened
from driver.identification.correction import Correction, Derivatives, SecondMesh
from driver.identification.fit import Fit
from driver.identification.step_error import StepError
from solver_adapters.interface import NotRunError, SolverError
from solver_adapters.jobs.errors import JobError
from solver_adapters.jobs.status import Status
from tests.driver.diagnosis.search.erring_solvers import ErringWithContrast, Failing
from tools import closed_form
from tools.closed_form_diagnosis import finer, identified

BENCH = closed_form.problem()
OBJECTIVE = closed_form.objective(BENCH, BENCH.truth)
TRUE, RIVAL = "grain_contrast", "boundary_position"


def failing(error: Exception) -> FineModels:
    return FineModels(replace(BENCH.model, adapter=Failing(error)))


@cache
def refitted() -> tuple[Fit, list[Refit]]:
    """The baseline, and the true cause and its rival refitted under its correction."""
    working = replace(BENCH.model, adapter=ErringWithContrast())
    made = closed_form.objective(BENCH, BENCH.truth | {"tau0_grain2": 3.0})
    objective, baseline = identified(replace(BENCH, model=working), replace(made, model=working))
    causes, names = screened(objective.model, baseline.best.free, (TRUE, RIVAL))
    screening = objective.evaluate(baseline.values, names)
    rows = {name: row for name, row in zip(screening.free, screening.jacobian, strict=True)}
    scores = [
        score(cause, np.array([rows[n] for n in cause.parameters]), baseline.best, len(causes))
        for cause in causes
    ]
    refits = refit_causes(scores, screening, baseline.best, objective, Executor(1, 1))
    return baseline, sorted(refits, key=lambda refit: -refit.log_evidence)


def names_of(refits: list[Refit]) -> list[str]:
    return [refit.cause.name for refit in refits]


def test_what_the_working_mesh_gets_wrong_at_a_cause_no_longer_speaks_against_it() -> None:
    baseline, before = refitted()
    assert names_of(before) == [RIVAL, TRUE]
    executor = Executor(1, 1)
    after = with_candidate_corrections(before, baseline.best, FineModels(finer(BENCH)), executor)
    assert names_of(after) == [TRUE, RIVAL]
    for refits, at in ((before, "at the baseline"), (after, "at its end")):
        assert {refit.corrected for refit in refits} == {at}
    assert after[0].log_evidence > before[1].log_evidence + 10
    # Where the mesh errs no more than at the baseline, nothing has changed.
    assert after[1].log_evidence == pytest.approx(before[0].log_evidence, abs=0.2)


def test_a_refit_that_cannot_be_simulated_finer_stays_and_the_log_says_so(
    lines: list[str],
) -> None:
    baseline, before = refitted()
    never = failing(SolverError("no step is short enough\nstep 3"))
    after = with_candidate_corrections(before, baseline.best, never, Executor(1, 1))
    assert after == before
    # What the refits told when they were made stands before.
    assert lines[-len(before) :] == [
        f"  {refit.cause.name}: log evidence {refit.log_evidence:+.1f} as it was, for its end "
        "cannot be simulated (no step is short enough)"
        for refit in before
    ]


@pytest.mark.parametrize("error", [NotRunError("absent"), JobError("bar", Status.KILLED)], ids=str)
def test_a_finer_simulation_that_was_not_run_is_not_done_without(error: SolverError) -> None:
    baseline, before = refitted()
    with pytest.raises(type(error)):
        with_candidate_corrections(before, baseline.best, failing(error), Executor(1, 1))


@pytest.mark.parametrize("error", [NotRunError("absent"), JobError("bar", Status.KILLED)], ids=str)
def test_a_second_mesh_that_was_not_run_is_not_done_without(error: SolverError) -> None:
    baseline, _ = refitted()
    meshes = FineModels(finer(BENCH), lambda: failing(error).one)
    with pytest.raises(type(error)):
        meshes.corrections(OBJECTIVE, baseline, True, Executor(1, 1))


def test_a_second_mesh_that_cannot_be_simulated_is_done_without_and_the_log_says_so(
    lines: list[str],
) -> None:
    baseline, _ = refitted()
    meshes = FineModels(finer(BENCH), lambda: failing(SolverError("no step")).one)
    _, between = meshes.corrections(OBJECTIVE, baseline, True, Executor(1, 1))
    assert between is None and "  one mesh has to do: no step" in lines


def test_one_that_leads_alone_is_not_simulated(
    lines: list[str],
) -> None:
    baseline, (first, second) = refitted()
    far = replace(second, log_evidence=first.log_evidence - REACH - 0.1)
    never = failing(AssertionError())
    executor = Executor(1, 1)
    assert with_candidate_corrections([first, far], baseline.best, never, executor) == [first, far]
    assert with_candidate_corrections([], baseline.best, never, executor) == [] and not lines


def with_derivatives(refit: Refit, baseline: Fit) -> Refit:
    """The refit of the true cause under the correction as its derivatives take it to the end."""
    objective, values, name = refit.objective, baseline.values, "tau0_grain2"
    working = objective.model.predict(values, (name,))
    finest = finer(BENCH).predict(values, (name,))
    known = Derivatives(values, (objective.parameters[name],), working, finest)
    correction = replace(objective.correction, derivatives=known)
    return replace(refit, objective=replace(objective, correction=correction))


@pytest.mark.parametrize(("behind", "corrected"), [(24.0, True), (32.0, False)])
def test_one_behind_is_corrected_where_its_correction_has_moved_by_as_much_on_its_way(
    behind: float, corrected: bool, lines: list[str]
) -> None:
    """By 6.5 σ, and by 2.5 beside what is fitted: that may bring 18 beside the 10 of any other."""
    baseline, (rival, true) = refitted()
    far = replace(with_derivatives(true, baseline), log_evidence=rival.log_evidence - behind)
    executor, finest = Executor(1, 1), FineModels(finer(BENCH))
    lines.clear()
    after = with_candidate_corrections([rival, far], baseline.best, finest, executor)
    assert (names_of(after) == [TRUE, RIVAL]) == corrected == bool(lines)


@pytest.mark.parametrize(("behind", "corrected"), [(28.0, True), (32.0, False)])
def test_of_a_large_effect_rivals_within_a_share_of_its_evidence_are_corrected(
    behind: float, corrected: bool, lines: list[str]
) -> None:
    baseline, before = refitted()
    leading = replace(before[0], log_evidence=200.0)
    rival = replace(before[1], log_evidence=200.0 - behind)
    assert 200.0 * REACH_OF_LARGE == pytest.approx(30.0)
    executor, finest = Executor(1, 1), FineModels(finer(BENCH))
    lines.clear()
    after = with_candidate_corrections([leading, rival], baseline.best, finest, executor)
    assert (after != [leading, rival]) == corrected == bool(lines)


def test_a_rival_is_corrected_on_as_long_as_it_may_still_lead(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The first correction may change the order by more than the rivals are apart."""
    baseline, (first, second) = refitted()
    course = {first.cause.name: [100.0, 70.0, 90.0, 90.5], second.cause.name: [95.0, 99.0, 98.5]}
    taken: list[str] = []

    def corrected(task: Any) -> Refit:
        refit: Refit = task.refit
        name = refit.cause.name
        taken.append(name)
        return replace(refit, log_evidence=course[name][taken.count(name)])

    monkeypatch.setattr(candidate_correction, "_corrected", corrected)
    monkeypatch.setattr(candidate_correction, "_at_its_end", lambda refit, end, at: end)
    begin = [replace(r, log_evidence=course[r.cause.name][0]) for r in (first, second)]
    models = FineModels(finer(BENCH))
    after = with_candidate_corrections(begin, baseline.best, models, Executor(1, 1))
    # 70 is 29 behind 99, within 10, 30 and 4; 99 has settled by its next change.
    assert [r.log_evidence for r in after] == [98.5, 90.5]
    assert taken.count(first.cause.name) == 3 and taken.count(second.cause.name) == 2


def test_a_refit_that_never_settles_is_corrected_five_times(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    baseline, (first, second) = refitted()
    taken: list[str] = []

    def corrected(task: Any) -> Refit:
        refit: Refit = task.refit
        taken.append(refit.cause.name)
        swing = 0.0 if refit.cause == first.cause else 2.0 * (-1.0) ** len(taken)
        return replace(refit, log_evidence=refit.log_evidence + swing)

    monkeypatch.setattr(candidate_correction, "_corrected", corrected)
    monkeypatch.setattr(candidate_correction, "_at_its_end", lambda refit, end, at: end)
    begin = [replace(first, log_evidence=100.0), replace(second, log_evidence=95.0)]
    with_candidate_corrections(begin, baseline.best, FineModels(finer(BENCH)), Executor(1, 1))
    assert taken.count(first.cause.name) == 1 and taken.count(second.cause.name) == 5


def test_of_a_refit_whose_second_correction_fails_the_log_tells_what_the_first_one_made_of_it(
    monkeypatch: pytest.MonkeyPatch, lines: list[str]
) -> None:
    baseline, (first, second) = refitted()
    ends: dict[str, list[float | None]] = {
        first.cause.name: [100.0], second.cause.name: [99.0, None],
    }  # fmt: skip

    def corrected(task: Any) -> Refit | Failure:
        refit: Refit = task.refit
        evidence = ends[refit.cause.name].pop(0)
        return Failure("no step") if evidence is None else replace(refit, log_evidence=evidence)

    monkeypatch.setattr(candidate_correction, "_corrected", corrected)
    monkeypatch.setattr(candidate_correction, "_at_its_end", lambda refit, end, at: end)
    begin = [replace(first, log_evidence=100.0), replace(second, log_evidence=95.0)]
    after = with_candidate_corrections(
        begin, baseline.best, FineModels(finer(BENCH)), Executor(1, 1)
    )
    assert [refit.log_evidence for refit in after] == [100.0, 99.0]
    told = "log evidence +95.0 → +99.0, for its end cannot be simulated (no step)"
    assert lines[-1] == f"  {second.cause.name}: {told}"


def test_one_that_has_fallen_far_behind_is_not_corrected_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """16 behind, its own change 3 and that of the best 2."""
    baseline, (first, second) = refitted()
    after_one = {first.cause.name: 103.0, second.cause.name: 87.0}
    taken: list[str] = []

    def corrected(task: Any) -> Refit:
        refit: Refit = task.refit
        name = refit.cause.name
        taken.append(name)
        return replace(refit, log_evidence=after_one[name])

    monkeypatch.setattr(candidate_correction, "_corrected", corrected)
    monkeypatch.setattr(candidate_correction, "_at_its_end", lambda refit, end, at: end)
    begin = [replace(first, log_evidence=101.0), replace(second, log_evidence=90.0)]
    models = FineModels(finer(BENCH))
    after = with_candidate_corrections(begin, baseline.best, models, Executor(1, 1))
    assert [r.log_evidence for r in after] == [103.0, 87.0] and len(taken) == 2


@pytest.mark.parametrize(("gained", "again"), [(21.0, False), (24.0, True)])
def test_one_that_gains_is_corrected_on_where_twice_as_much_may_make_it_lead(
    gained: float, again: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A turn of 5° gained 33 and was 65 behind, led by 11 in the end; here 78 less that."""
    baseline, (first, second) = refitted()
    ends = {first.cause.name: [100.0], second.cause.name: [22.0 + gained, 105.0, 105.5]}
    taken: list[str] = []

    def corrected(task: Any) -> Refit:
        refit: Refit = task.refit
        taken.append(refit.cause.name)
        return replace(refit, log_evidence=ends[refit.cause.name].pop(0))

    monkeypatch.setattr(candidate_correction, "_corrected", corrected)
    monkeypatch.setattr(candidate_correction, "_at_its_end", lambda refit, end, at: end)
    monkeypatch.setattr(candidate_correction, "_may_gain", lambda refit, at: 100.0)
    begin = [replace(first, log_evidence=100.0), replace(second, log_evidence=22.0)]
    after = with_candidate_corrections(
        begin, baseline.best, FineModels(finer(BENCH)), Executor(1, 1)
    )
    assert taken.count(second.cause.name) == (3 if again else 1)
    assert after[0].cause.name == (second if again else first).cause.name


@pytest.mark.parametrize(("behind", "is_taken"), [(16.0, False), (14.0, True)])
def test_a_third_refit_is_corrected_where_as_much_as_the_first_two_changed_may_make_it_lead(
    behind: float, is_taken: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The best ends at 100 and changed by 2, the second by 3: 10, 3 and 2 are 15."""
    baseline, (first, second) = refitted()
    third = replace(second, cause=replace(second.cause, name="third"))
    refits = [
        replace(first, log_evidence=98.0),
        replace(second, log_evidence=88.0),
        replace(third, log_evidence=100.0 - behind),
    ]
    ends = {refits[0].cause.name: 100.0, refits[1].cause.name: 91.0, "third": 80.0}
    taken: list[str] = []

    def corrected(task: Any) -> Refit:
        refit: Refit = task.refit
        taken.append(refit.cause.name)
        return replace(refit, log_evidence=ends[refit.cause.name])

    monkeypatch.setattr(candidate_correction, "_corrected", corrected)
    monkeypatch.setattr(candidate_correction, "_at_its_end", lambda refit, end, at: end)
    models = FineModels(finer(BENCH))
    with_candidate_corrections(refits, baseline.best, models, Executor(1, 1))
    assert ("third" in taken) == is_taken
    assert set(taken) >= {first.cause.name, second.cause.name}


def test_the_one_next_to_the_best_is_corrected_however_far_behind(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The second one falls behind the third and the fourth, which was not near the best."""
    baseline, (first, second) = refitted()
    names = [first.cause.name, second.cause.name, "third", "fourth", "fifth"]
    evidence, ends = [300.0, 280.0, 270.0, 265.0, 262.0], [300.0, 262.5, 260.0, 268.0, 0.0]
    refits = [
        replace(second, cause=replace(second.cause, name=name), log_evidence=value)
        for name, value in zip(names, evidence, strict=True)
    ]
    taken: list[str] = []

    def corrected(task: Any) -> Refit:
        refit: Refit = task.refit
        taken.append(refit.cause.name)
        return replace(refit, log_evidence=ends[names.index(refit.cause.name)])

    monkeypatch.setattr(candidate_correction, "_corrected", corrected)
    monkeypatch.setattr(candidate_correction, "_at_its_end", lambda refit, end, at: end)
    models = FineModels(finer(BENCH))
    after = with_candidate_corrections(refits, baseline.best, models, Executor(1, 1))
    assert taken == names[:4]
    assert [refit.cause.name for refit in after] == [names[0], "fourth", names[1], "fifth", "third"]


def test_refits_are_corrected_with_what_a_second_mesh_adds_at_the_baseline() -> None:
    baseline, before = refitted()
    executor, models = Executor(1, 1), FineModels(finer(BENCH))
    motion, load = (np.zeros_like(a) for a in before[0].objective.correction.of_mesh)
    second = SecondMesh(Correction(motion, load + 3.0), 0.667)
    both = [replace(r, objective=replace(r.objective, second=second)) for r in before]
    alone, added = (
        with_candidate_corrections(refits, baseline.best, models, executor)
        for refits in (before, both)
    )
    one, other = (
        next(r for r in after if r.cause.name == TRUE).objective for after in (alone, added)
    )
    assert one is not before[0].objective and other.second is second
    assert np.mean(np.asarray(other.correction.load) - one.correction.load) == pytest.approx(
        3.0, abs=0.5
    )


@pytest.mark.parametrize("cut", [0, 1])
def test_what_time_steps_leave_at_the_baseline_holds_at_a_refit_that_takes_as_many(
    monkeypatch: pytest.MonkeyPatch, cut: int
) -> None:
    """Where others were cut it is simulated; so it is of refits that lead."""
    baseline, (first, second) = refitted()
    response = first.fit.best.prediction.response
    response = replace(response, ends=np.append(response.ends, np.arange(float(cut))))
    prediction = replace(first.fit.best.prediction, response=response)
    best = replace(first.fit.best, prediction=prediction)
    other = replace(first, fit=replace(first.fit, best=best))
    left = StepError(np.zeros((1, 1, 3)), np.zeros(1))
    asked: list[StepError | None] = []

    def note(*_: Any, left_by_steps: StepError | None, **__: Any) -> Correction:
        asked.append(left_by_steps)
        raise SolverError("no more is asked")

    monkeypatch.setattr(candidate_correction, "correction", note)
    models = FineModels(finer(BENCH))
    assert isinstance(corrected_refit(other, models.one, baseline.best, 3, left), Failure)
    assert asked == [None if cut else left]
    asked.clear()
    after = with_candidate_corrections([other, second], baseline.best, models, Executor(1, 1))
    assert after == [other, second] and asked == [None, None]
