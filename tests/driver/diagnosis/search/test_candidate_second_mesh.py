from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from driver.common.errors import InputError
from driver.common.outcomes import Failure
from driver.diagnosis.answer.result_types import Refit
from driver.diagnosis.causes.causes import Cause
from driver.diagnosis.causes.ebsd_flips import FLIPS
from driver.diagnosis.search import candidate_second_mesh
from driver.diagnosis.search.candidate_correction import REACH, REACH_OF_LARGE
from driver.diagnosis.search.candidate_second_mesh import with_second_mesh_at_ends
from driver.diagnosis.search.fine_models import FineModels
from driver.diagnosis.search.refit import Executor, refit_causes
from driver.diagnosis.statistics.score_test import WORTH, score
from driver.diagnosis.statistics.screening import screened
from driver.forward.model import ForwardModel
from driver.identification.correction import correction
from driver.identification.fit import Fit, fit_from
from driver.identification.identify import with_correction
from driver.identification.line_search import newton
from meshes.arrays import FloatArray
from solver_adapters.interface import NotRunError, Simulation, SolverError
from tests.driver.diagnosis.search.erring_solvers import ErringWithContrast, Failing
from tools import closed_form
from tools.closed_form import SIZES
from tools.closed_form_diagnosis import finer, identified

BENCH = closed_form.problem()
TRUE, RIVAL = "grain_contrast", "boundary_position"
HERE = Executor(1, 1)
SIZE = SIZES[1] / 1.5


WORKING = replace(BENCH, model=replace(BENCH.model, adapter=ErringWithContrast()))
ONE, SECOND = finer(WORKING), finer(BENCH, 0.002)


def meshes(size: float | None = SIZE, second: ForwardModel = SECOND) -> FineModels:
    """A first finer mesh that errs as the working one, and a second one that does not."""
    return FineModels(ONE, lambda: second, size)


@cache
def refitted(size: float | None = SIZE) -> tuple[Fit, list[Refit]]:
    """The baseline, and the true cause and its rival, refitted with both meshes at the baseline."""
    made = closed_form.objective(BENCH, BENCH.truth | {"tau0_grain2": 3.0})
    objective, baseline = identified(WORKING, replace(made, model=WORKING.model))
    change = correction(WORKING.model, ONE, baseline.best.prediction, baseline.values)
    second = meshes(size).second(replace(objective, correction=change), baseline)
    objective = with_correction(objective, 1.0, change, SIZES, second)
    baseline = fit_from(baseline.best, objective, 12)
    causes, names = screened(objective.model, baseline.best.free, (TRUE, RIVAL))
    screening = objective.evaluate(baseline.values, names)
    rows = {name: row for name, row in zip(screening.free, screening.jacobian, strict=True)}
    scores = [
        score(cause, np.array([rows[n] for n in cause.parameters]), baseline.best, len(causes))
        for cause in causes
    ]
    refits = refit_causes(scores, screening, baseline.best, objective, HERE)
    return baseline, sorted(refits, key=lambda refit: -refit.log_evidence)


def near_each_other() -> tuple[Fit, list[Refit]]:
    """The same, as if they were as likely as each other."""
    baseline, refits = refitted()
    return baseline, [replace(refit, log_evidence=refits[0].log_evidence) for refit in refits]


def names_of(refits: list[Refit]) -> list[str]:
    return [refit.cause.name for refit in refits]


def test_what_the_first_finer_mesh_gets_wrong_at_a_cause_no_longer_speaks_against_it() -> None:
    baseline, (rival, true) = refitted()
    assert (rival.cause.name, true.cause.name) == (RIVAL, TRUE)
    near = replace(true, log_evidence=rival.log_evidence - 1.0)
    after = with_second_mesh_at_ends([rival, near], baseline.best, meshes(), HERE)
    assert names_of(after) == [TRUE, RIVAL]
    assert after[0].log_evidence > true.log_evidence + 10
    # Where the mesh errs no more than at the baseline, nothing has changed.
    assert after[1].log_evidence == pytest.approx(rival.log_evidence, abs=0.3)


def test_what_the_second_mesh_adds_takes_the_place_of_what_it_adds_at_the_baseline() -> None:
    baseline, refits = near_each_other()
    for refit in with_second_mesh_at_ends(refits, baseline.best, meshes(), HERE):
        assert refit.corrected == "at its end, on the second mesh"
        objective, values = refit.objective, refit.fit.values
        working, one, second = (m.predict(values) for m in (WORKING.model, ONE, SECOND))
        assert objective.second is not None and objective.second.size == SIZE
        added = objective.correction, objective.correction.without_second(objective.second)
        for found, finest in zip(added, (second, one), strict=True):
            # It was taken where the refit stood before its last pass.
            motion, load = finest.motion - working.motion, finest.load - working.load
            most = np.abs(second.motion - working.motion).max()
            np.testing.assert_allclose(found.at(values).motion, motion, atol=0.1 * most)
            np.testing.assert_allclose(found.at(values).load, load, atol=0.1)


def test_a_refit_is_fitted_to_its_end_with_what_the_second_mesh_adds() -> None:
    baseline, refits = near_each_other()
    (before,) = (r for r in refits if r.cause.name == TRUE)
    after = with_second_mesh_at_ends(refits, baseline.best, meshes(), HERE)[0]
    values = [r.fit.values["tau0_grain2"] for r in (before, after)]
    assert values[0] < 1.6 and values[1] == pytest.approx(3.0, rel=0.1)
    assert newton(after.objective, after.fit.best)[1] < 0.5


def test_side_by_side_refits_end_as_one_after_the_other() -> None:
    baseline, refits = near_each_other()
    one, two = (
        with_second_mesh_at_ends(refits, baseline.best, meshes(), Executor(n, 1)) for n in (1, 2)
    )
    assert [r.log_evidence for r in one] == [r.log_evidence for r in two]


def test_of_two_meshes_as_good_as_each_other_their_mean_is_taken_at_the_end() -> None:
    baseline, refits = refitted(None)
    rival, true = (next(r for r in refits if r.cause.name == n) for n in (RIVAL, TRUE))
    near = [rival, replace(true, log_evidence=rival.log_evidence - 1.0)]
    after = with_second_mesh_at_ends(near, baseline.best, meshes(None), HERE)
    (better, _) = with_second_mesh_at_ends(near, baseline.best, meshes(), HERE)
    mean = next(r for r in after if r.cause.name == TRUE)
    assert mean.objective.second is not None and mean.objective.second.off is not None
    assert true.log_evidence < mean.log_evidence < better.log_evidence


@pytest.mark.parametrize(("most", "behind"), [(40.0, REACH), (200.0, 200.0 * REACH_OF_LARGE)])
def test_one_that_leads_alone_is_not_simulated(
    most: float, behind: float, lines: list[str]
) -> None:
    baseline, (first, second) = refitted()
    first = replace(first, log_evidence=most)
    never = meshes(second=replace(SECOND, adapter=Failing(AssertionError())))
    lines.clear()
    far = [first, replace(second, log_evidence=most - behind - 0.1)]
    assert with_second_mesh_at_ends(far, baseline.best, never, HERE) == far
    assert with_second_mesh_at_ends(far[:1], baseline.best, never, HERE) == far[:1]
    assert with_second_mesh_at_ends([], baseline.best, never, HERE) == [] and not lines
    near = [first, replace(second, log_evidence=most - behind + 0.1)]
    assert with_second_mesh_at_ends(near, baseline.best, meshes(), HERE) != near


def test_where_one_mesh_had_to_do_it_does_here() -> None:
    baseline, refits = near_each_other()
    alone = FineModels(ONE)
    assert with_second_mesh_at_ends(refits, baseline.best, alone, HERE) == refits
    without = [replace(r, objective=replace(r.objective, second=None)) for r in refits]
    assert with_second_mesh_at_ends(without, baseline.best, meshes(), HERE) == without


class FailingWithContrast(closed_form.ClosedFormSolver):
    def answer(self, simulation: Simulation) -> tuple[FloatArray, FloatArray]:
        if simulation.material.tau0_grain2 != 1.0:
            raise SolverError("no step is short enough\nstep 3")
        return super().answer(simulation)


def test_where_one_of_the_leaders_cannot_be_simulated_none_leads_by_the_second_mesh(
    lines: list[str],
) -> None:
    baseline, refits = near_each_other()
    never = meshes(second=replace(SECOND, adapter=FailingWithContrast(0.002)))
    lines.clear()
    assert with_second_mesh_at_ends(refits, baseline.best, never, HERE) == refits
    assert lines[1:] == [
        f"  {TRUE} cannot be simulated on it (no step is short enough): all stay as they were"
    ]


def test_where_the_second_mesh_cannot_be_made_all_stay_as_they_were(lines: list[str]) -> None:
    baseline, refits = near_each_other()

    def unmade() -> ForwardModel:
        raise InputError("the prism cannot be meshed")

    lines.clear()
    never = FineModels(ONE, unmade, SIZE)
    assert with_second_mesh_at_ends(refits, baseline.best, never, HERE) == refits
    assert lines[1:] == ["  it cannot be made (the prism cannot be meshed)"]


def test_what_is_no_evidence_is_not_simulated() -> None:
    baseline, refits = refitted()
    little = [replace(refit, log_evidence=WORTH) for refit in refits]
    never = meshes(second=replace(SECOND, adapter=Failing(AssertionError())))
    assert with_second_mesh_at_ends(little, baseline.best, never, HERE) == little


def test_a_refit_goes_on_until_its_evidence_settles() -> None:
    """The contrast takes what the mesh made of it with every pass: 1.5, 2.0, 2.3, 2.6, 2.8."""
    baseline, refits = near_each_other()
    after = with_second_mesh_at_ends(refits, baseline.best, meshes(), HERE)
    again = with_second_mesh_at_ends(after, baseline.best, meshes(), HERE)
    for refit, more in zip(after, again, strict=True):
        assert more.cause == refit.cause
        assert more.log_evidence == pytest.approx(refit.log_evidence, abs=1.0)


def test_a_simulation_that_was_not_run_is_not_done_without() -> None:
    baseline, refits = near_each_other()
    never = meshes(second=replace(SECOND, adapter=Failing(NotRunError("absent"))))
    with pytest.raises(NotRunError):
        with_second_mesh_at_ends(refits, baseline.best, never, HERE)


def test_the_second_mesh_has_the_grains_of_a_flip_turned(monkeypatch: pytest.MonkeyPatch) -> None:
    baseline, refits = near_each_other()
    flip = FLIPS[0]
    turned = [replace(refits[0], cause=flip), refits[1]]
    seen: dict[str, FloatArray] = {}

    def fitted(task: Any) -> Failure:
        orientations = task.second.simulation(BENCH.truth).orientations
        seen[task.refit.cause.name] = np.array(orientations)
        return Failure("no need")

    monkeypatch.setattr(candidate_second_mesh, "_fitted", fitted)
    with_second_mesh_at_ends(turned, baseline.best, meshes(), HERE)
    measured = np.array(SECOND.simulation(BENCH.truth).orientations)
    assert np.array_equal(seen[refits[1].cause.name], measured)
    assert not np.allclose(seen[flip.name], measured)


def judged(
    monkeypatch: pytest.MonkeyPatch, before: dict[str, float], after: dict[str, float],
    misfits: dict[str, float] | None = None,
) -> tuple[list[str], list[str]]:  # fmt: skip
    """The causes that are fitted again, in this order, and all of them at last, best first.

    A misfit goes with the evidence, but for what is stated.
    """
    baseline, (first, _) = refitted()
    second = first.objective.second
    refits = [
        replace(first, cause=replace(first.cause, name=name), log_evidence=value)
        for name, value in before.items()
    ]
    taken: list[str] = []

    def fitted(task: Any) -> candidate_second_mesh._End:
        taken.append(task.refit.cause.name)
        assert second is not None
        return candidate_second_mesh._End(second, task.refit.fit)

    def refit_of(cause: Cause, *_: object) -> Refit:
        return replace(first, cause=cause, log_evidence=after[cause.name])

    monkeypatch.setattr(candidate_second_mesh, "_fitted", fitted)
    monkeypatch.setattr(candidate_second_mesh, "refit_of", refit_of)
    monkeypatch.setattr(candidate_second_mesh, "_to_come", lambda before, after, baseline: 0.0)
    behind = misfits or {}
    monkeypatch.setattr(
        Refit, "own_misfit",
        property(lambda r: behind.get(r.cause.name, 0.0) - 2 * r.log_evidence),
    )  # fmt: skip
    ended = with_second_mesh_at_ends(refits, baseline.best, meshes(), HERE)
    return taken, names_of(ended)


@pytest.mark.parametrize(("behind", "is_near"), [(44.0, True), (46.0, False)])
def test_those_are_judged_that_may_come_within_reach_and_the_one_next_to_them(
    behind: float, is_near: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The best ends at 288 after a gain of 34, another one gained 35: 10 and 35 are 45."""
    before = {"first": 254.0, "second": 248.0, "third": 288.0 - behind, "fourth": 230.0}
    after = {"first": 288.0, "second": 283.0, "third": 270.0, "fourth": 250.0}
    taken, ended = judged(monkeypatch, before, after)
    assert taken == ["first", "second", "third", *(["fourth"] if is_near else [])]
    assert ended == ["first", "second", "third", "fourth"]


def test_next_to_those_within_reach_is_one_that_gains_as_the_others_did(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The third is judged and loses, so that the fourth, with their mean gain, is next."""
    before = {"first": 254.0, "second": 248.0, "third": 240.0, "fourth": 238.0, "fifth": 200.0}
    after = {"first": 288.0, "second": 283.0, "third": 200.0, "fourth": 262.0}
    taken, ended = judged(monkeypatch, before, after)
    assert taken == ["first", "second", "third", "fourth"]
    assert ended[:3] == ["first", "second", "fourth"]


def test_the_one_next_to_the_best_is_judged_however_far_behind(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The second one loses, so that the third and then the fourth are next."""
    before = {"first": 100.0, "second": 95.0, "third": 80.0, "fourth": 75.0, "fifth": 60.0}
    after = {"first": 100.0, "second": 50.0, "third": 70.0, "fourth": 77.0}
    taken, ended = judged(monkeypatch, before, after)
    assert taken == ["first", "second", "third", "fourth"]
    assert ended == ["first", "fourth", "third", "fifth", "second"]


def test_one_that_may_overtake_all_that_were_judged_is_judged(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Both leaders lose, and another one behind them does not."""
    before = {"first": 100.0, "second": 95.0, "third": 70.0}
    after = {"first": 60.0, "second": 58.0, "third": 71.0}
    taken, ended = judged(monkeypatch, before, after)
    assert taken == ["first", "second", "third"] and ended[0] == "third"


def test_one_that_a_prior_holds_back_is_judged_for_its_misfit(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """70 behind by evidence, no more than 4 by misfit where it gains as much as the first."""
    before = {"first": 254.0, "second": 248.0, "next": 230.0, "third": 184.0}
    after = {"first": 288.0, "second": 283.0, "next": 265.0, "third": 219.0}
    alone, _ = judged(monkeypatch, before, after)
    beside, _ = judged(monkeypatch, before, after, {"third": -136.0})
    assert alone == ["first", "second", "next"]
    assert sorted(beside) == ["first", "next", "second", "third"]


@pytest.mark.parametrize(("way", "passes"), [(2.0, 1), (5.0, 2)])
def test_another_pass_follows_where_the_way_of_the_last_one_may_change_the_evidence(
    way: float, passes: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a gain of 35 on a way of 10 σ those of 2 σ and 5 σ leave 1.4 and 8.8."""
    baseline, (first, _) = refitted()
    second = replace(first, cause=replace(first.cause, name="second"))
    taken: list[str] = []

    def fitted(task: Any) -> candidate_second_mesh._End:
        taken.append(task.refit.cause.name)
        added = task.refit.objective.second
        return candidate_second_mesh._End(added, task.refit.fit)

    def refit_of(cause: Cause, *_: object) -> Refit:
        return replace(first, cause=cause, log_evidence=285.0)

    def on_the_way(objective: object, begin: object, at: object) -> float:
        return 10.0 if begin is baseline.best.values else way

    monkeypatch.setattr(candidate_second_mesh, "_fitted", fitted)
    monkeypatch.setattr(candidate_second_mesh, "refit_of", refit_of)
    monkeypatch.setattr(candidate_second_mesh, "changed_on_the_way", on_the_way)
    refits = [replace(refit, log_evidence=250.0) for refit in (first, second)]
    with_second_mesh_at_ends(refits, baseline.best, meshes(), HERE)
    assert len(taken) == 2 * passes


def test_one_that_never_settles_is_left_after_four_passes(monkeypatch: pytest.MonkeyPatch) -> None:
    baseline, (first, _) = refitted()
    refits = [
        replace(first, cause=replace(first.cause, name=name), log_evidence=250.0)
        for name in ("first", "second")
    ]
    ends = iter(range(100))

    def refit_of(cause: Cause, *_: object) -> Refit:
        return replace(first, cause=cause, log_evidence=255.0 - 5.0 * (next(ends) // 2 % 2))

    monkeypatch.setattr(candidate_second_mesh, "refit_of", refit_of)
    # Its correction has no derivatives, so that all of a change may come again.
    assert first.objective.correction.derivatives is None
    with_second_mesh_at_ends(refits, baseline.best, meshes(), HERE)
    assert next(ends) == 2 * 4
