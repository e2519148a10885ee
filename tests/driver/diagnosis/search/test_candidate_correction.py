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
from driver.forward.model import ForwardModel
from driver.identification.correction import Correction, Derivatives, SecondMesh
from driver.identification.fit import Fit
from driver.identification.line_search import newton
from meshes.arrays import FloatArray
from solver_adapters.interface import NotRunError, Simulation, SolverError
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
    assert lines[1:] == [
        f"  {refit.cause.name}: log evidence {refit.log_evidence:+.1f} as it was, for it cannot be "
        "simulated (no step is short enough)"
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


def with_derivatives(refit: Refit, baseline: Fit, one: ForwardModel | None = None) -> Refit:
    """The refit of the true cause under the correction as its derivatives take it to the end."""
    one = finer(BENCH) if one is None else one
    objective, values, name = refit.objective, baseline.values, "tau0_grain2"
    working = objective.model.predict(values, (name,))
    finest = one.predict(values, (name,))
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


@pytest.mark.parametrize(
    ("coming", "wanted"),
    [((0.9, np.inf), [RIVAL]), ((1.1, np.inf), [TRUE, RIVAL]), ((0.9, 0.9), [])],
)
def test_what_has_settled_under_the_correction_where_it_stands_is_not_corrected_once_more(
    coming: tuple[float, float],
    wanted: list[str],
    monkeypatch: pytest.MonkeyPatch,
    lines: list[str],
) -> None:
    baseline, before = refitted()
    by_name = {refit.cause.name: refit for refit in before}
    taken: list[str] = []

    def corrected(task: Any) -> Refit:
        refit: Refit = task.refit
        taken.append(refit.cause.name)
        return replace(refit)

    monkeypatch.setattr(candidate_correction, "_corrected", corrected)
    monkeypatch.setattr(candidate_correction, "_at_its_end", lambda refit, end, at: end)
    begin = [
        replace(by_name[name], log_evidence=evidence, to_come=come)
        for name, evidence, come in zip((TRUE, RIVAL), (100.0, 95.0), coming, strict=True)
    ]
    lines.clear()
    models = FineModels(finer(BENCH))
    after = with_candidate_corrections(begin, baseline.best, models, Executor(1, 1))
    assert taken == wanted and names_of(after) == [TRUE, RIVAL]
    # What was not corrected is not told, and where nothing was there is no word of it.
    assert [line.split(":")[0].strip() for line in lines[1:]] == wanted
    assert bool(lines) == bool(wanted)


@pytest.mark.parametrize(("most", "at_limit"), [(1, True), (12, False)])
def test_a_refit_knows_what_another_correction_may_change_by_its_way_and_what_its_fit_lacks(
    most: int, at_limit: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(candidate_correction, "_MOST", most)
    baseline, (_, true) = refitted()
    before = with_derivatives(true, baseline)
    after = corrected_refit(before, finer(BENCH), baseline.best)
    assert isinstance(after, Refit)
    way = before.fit.away_from(baseline.values, before.objective.parameters)
    rest = after.fit.away_from(before.fit.values, before.objective.parameters)
    changed = abs(after.log_evidence - before.log_evidence)
    lacking = 0.5 * newton(after.objective, after.fit.best)[1] ** 2
    assert min(way, rest) > 0.0 and changed > 1.0 and after.fit.at_limit == at_limit
    assert lacking > 1.0 or not at_limit
    expected = changed * (rest / way) ** 2 + (lacking if at_limit else 0.0)
    assert after.to_come == pytest.approx(expected)


def course(
    monkeypatch: pytest.MonkeyPatch, begin: list[tuple[float, float]], ends: list[list[float]]
) -> tuple[list[int], list[float]]:
    """Which refits are corrected, by their numbers, and what all have at last.

    Args:
        monkeypatch: by which evidence is scheduled.
        begin: log evidence and what may come of each refit.
        ends: log evidence of each after each of its corrections; the last one stays.
    """
    baseline, (first, _) = refitted()
    taken: list[int] = []

    def corrected(task: Any) -> Refit:
        number = int(task.refit.cause.name)
        left = ends[number]
        taken.append(number)
        refit: Refit = task.refit
        return replace(refit, log_evidence=left.pop(0) if len(left) > 1 else left[0])

    monkeypatch.setattr(candidate_correction, "_corrected", corrected)
    monkeypatch.setattr(candidate_correction, "_at_its_end", lambda refit, end, at: end)
    refits = [
        replace(
            first, cause=replace(first.cause, name=str(number)), log_evidence=evidence, to_come=come
        )
        for number, (evidence, come) in enumerate(begin)
    ]
    models = FineModels(finer(BENCH))
    after = with_candidate_corrections(refits, baseline.best, models, Executor(1, 1))
    by_name = {refit.cause.name: refit.log_evidence for refit in after}
    return taken, [by_name[str(number)] for number in range(len(begin))]


def test_beside_two_that_have_settled_the_next_one_is_corrected(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    begin = [(100.0, 0.9), (95.0, 0.9), (93.0, np.inf), (92.0, np.inf)]
    taken, after = course(monkeypatch, begin, [[], [], [120.0, 120.5], [92.0]])
    # What that gained, 27, may bring the last one to the front as well.
    assert taken == [2, 2, 3] and after == [100.0, 95.0, 120.5, 92.0]


def test_one_that_never_settles_is_left_after_five_corrections(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    swinging = [110.0, 100.0, 110.0, 100.0, 110.0, 100.0, 110.0]
    taken, _ = course(monkeypatch, [(100.0, np.inf), (95.0, np.inf)], [swinging, [95.0]])
    assert taken.count(0) == 5 and taken.count(1) == 1


def test_one_goes_on_by_what_another_correction_may_change_not_by_what_the_last_one_has(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(candidate_correction, "_to_come", lambda before, after: 0.9)
    taken, after = course(monkeypatch, [(100.0, np.inf), (95.0, np.inf)], [[120.0], [119.0]])
    assert taken == [0, 1] and after == [120.0, 119.0]


def test_what_may_come_of_one_that_was_corrected_before_is_no_measure_for_others(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of the first 300 may come, and nothing does: another one 21 behind is left as it is."""
    begin = [(200.0, 300.0), (195.0, np.inf), (179.0, np.inf)]
    taken, _ = course(monkeypatch, begin, [[200.0], [195.0], [179.0]])
    assert taken == [0, 1]


def test_one_that_cannot_be_simulated_finer_is_tried_once(monkeypatch: pytest.MonkeyPatch) -> None:
    baseline, before = refitted()
    tried: list[str] = []

    def fails(task: Any) -> Failure:
        tried.append(task.refit.cause.name)
        return Failure("no step is short enough")

    monkeypatch.setattr(candidate_correction, "_corrected", fails)
    models = FineModels(finer(BENCH))
    assert with_candidate_corrections(before, baseline.best, models, Executor(1, 1)) == before
    assert sorted(tried) == sorted(names_of(before))


class Saturating(closed_form.ClosedFormSolver):
    """A finer simulation that folds the face by a tangent of τ0 in grain 2 that soon saturates."""

    def answer(self, simulation: Simulation) -> tuple[FloatArray, FloatArray]:
        motion, load = super().answer(simulation)
        x = simulation.mesh.points[simulation.output_nodes, 0]
        motion[..., 2] += 5e-4 * np.tanh(100 * np.log(simulation.material.tau0_grain2)) * np.sin(x)
        return motion, load


def test_a_refit_whose_correction_bends_on_its_way_is_not_taken_for_settled() -> None:
    """At its end derivatives foretell no change, however much there was on the way."""
    finest = replace(BENCH.model, adapter=Saturating())
    baseline, (_, true) = refitted()
    before = with_derivatives(true, baseline, finest)
    after = corrected_refit(before, finest, baseline.best)
    assert isinstance(after, Refit)
    again = corrected_refit(after, finest, baseline.best)
    assert isinstance(again, Refit)
    assert after.to_come > min(1.0, abs(again.log_evidence - after.log_evidence))


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
