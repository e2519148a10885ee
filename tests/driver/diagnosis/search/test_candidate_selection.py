from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast
from unittest.mock import patch

import numpy as np
import pytest

from driver.diagnosis.answer.result_types import Refit
from driver.diagnosis.causes.causes import Cause
from driver.diagnosis.search import candidate_selection
from driver.diagnosis.search.candidate_selection import (
    LARGE,
    is_far_from_its_end,
    refits_of_likely,
    to_refit,
)
from driver.diagnosis.search.refit import Executor
from driver.diagnosis.statistics.score_test import Score, effects_of, score
from driver.diagnosis.statistics.screening import screened
from tools import closed_form
from tools.closed_form_diagnosis import identified, large_effect

BENCH = closed_form.problem()


def scored(p: float, evidence: float, angle: float = 0.0) -> Score:
    """A cause that does to the data what a unit vector at an angle in a plane says."""
    along = np.array([[np.cos(angle), np.sin(angle)]])
    return cast(
        Score,
        SimpleNamespace(p=p, log_evidence=evidence, directions=along, strengths=np.ones(1)),
    )


def test_a_cause_that_promises_as_much_as_the_seen_one_is_refitted_with_it() -> None:
    best, seen, near, far = (
        scored(*of) for of in ((0.015, 4.4), (0.004, 3.9), (0.05, 3.2), (0.3, 1.0))
    )
    assert to_refit([best, seen, near, far], 5) == [best, seen, near]
    assert to_refit([best, seen, near, far], 2) == [best, seen]
    assert to_refit([best, near, far], 5) == []  # where nothing is seen nothing is refitted


def test_a_cause_that_has_nothing_to_do_with_the_seen_one_is_not_refitted_with_it() -> None:
    seen, akin, strange = scored(0.004, 3.9), scored(0.05, 4.0, 0.9), scored(0.05, 4.1, 1.2)
    assert to_refit([strange, akin, seen], 5) == [akin, seen]


def test_close_rivals_of_the_best_are_refitted_however_many_they_are() -> None:
    tried = [scored(1e-9, evidence) for evidence in (40.0, 34, 33, 32, 31, 29, 12)]
    assert to_refit(tried, 2) == tried[:5]
    assert to_refit(tried, 6) == tried[:6]


def test_a_significant_cause_without_evidence_opens_the_door_for_no_other() -> None:
    best, near, odd = (scored(*of) for of in ((0.4, 1.6), (0.5, 1.2), (0.004, 0.01)))
    assert to_refit([best, near, odd], 5) == [odd]


CREW = Executor(1, 1)


def under_its_own_correction(refit: Refit, cause: Cause) -> Refit:
    return replace(refit, cause=cause, corrected="at its end")


def test_from_a_baseline_that_is_lost_no_refit_begins() -> None:
    """Its own next step is hundreds of σ long."""
    objective, baseline, augmented, tried = large_effect("stretch_curvature", 0.5)
    with patch.object(candidate_selection, "refit_causes", None):
        found = refits_of_likely(tried, (), augmented, baseline.best, objective, 5, CREW)
    assert found[0].cause.name == "stretch_not_proportional"
    assert found[0].fit.best.chi_load < 1.3 < LARGE < baseline.best.chi_load


def test_what_has_begun_where_it_shows_is_not_refitted_from_its_null() -> None:
    objective, baseline, augmented, tried = large_effect("Q", 60.0)
    (done,) = refits_of_likely(tried[:1], (), augmented, baseline.best, objective, 1, CREW)
    placed = replace(tried[0], cause=replace(tried[0].cause, name="band"))
    of_place = under_its_own_correction(done, placed.cause)
    with patch.object(candidate_selection, "refit_causes", return_value=[]) as begun:
        found = refits_of_likely([placed], [of_place], augmented, baseline.best, objective, 1, CREW)
        assert begun.call_args_list[0].args[0] == [] and found == [of_place]
        begun.reset_mock()
        refits_of_likely([placed], (), augmented, baseline.best, objective, 1, CREW)
        assert begun.call_args_list[0].args[0] == [placed]


def test_others_are_chosen_as_if_what_has_begun_where_it_shows_had_not_been_refitted() -> None:
    """Its evidence is that of a refit under its own correction, theirs is of first order."""
    objective, baseline, augmented, tried = large_effect("Q", 60.0)
    (done,) = refits_of_likely(tried[:1], (), augmented, baseline.best, objective, 1, CREW)
    placed = replace(tried[0], cause=replace(tried[0].cause, name="band"), log_evidence=1e4)
    of_place = under_its_own_correction(done, placed.cause)
    with patch.object(candidate_selection, "refit_causes", return_value=[]) as begun:
        refits_of_likely([placed, *tried], [of_place], augmented, baseline.best, objective, 2, CREW)
        assert begun.call_args_list[0].args[0] == to_refit(tried, 2)


def test_what_has_begun_where_it_shows_and_is_not_seen_is_not_added() -> None:
    objective, baseline, augmented, tried = large_effect("Q", 60.0)
    (done,) = refits_of_likely(tried[:1], (), augmented, baseline.best, objective, 1, CREW)
    unseen = replace(tried[0], cause=replace(tried[0].cause, name="band"), p=0.01)
    calm = replace(baseline.best, n_load=0)
    with patch.object(candidate_selection, "refit_causes", return_value=[]):
        of_place = [under_its_own_correction(done, unseen.cause)]
        assert refits_of_likely([unseen], of_place, augmented, calm, objective, 1, CREW) == []


def test_what_has_begun_where_it_shows_and_is_akin_to_what_is_seen_stands_beside_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of two that do the same noise makes one significant, and the answer is a set of both."""
    objective, baseline, augmented, tried = large_effect("Q", 60.0)
    (done,) = refits_of_likely(tried[:1], (), augmented, baseline.best, objective, 1, CREW)
    calm = replace(baseline.best, n_load=0)
    monkeypatch.setattr(candidate_selection, "_bent", lambda *_: False)
    causes = [replace(tried[0].cause, name=name) for name in ("seen", "akin", "strange")]
    across = np.zeros_like(tried[0].directions)
    scores = [
        replace(tried[0], cause=cause, p=p, log_evidence=evidence)
        for cause, p, evidence in zip(causes, (1e-4, 0.01, 0.01), (9.0, 8.0, 7.0), strict=True)
    ]
    scores[2] = replace(scores[2], directions=across)
    afar = [under_its_own_correction(done, cause) for cause in causes]
    with patch.object(candidate_selection, "refit_causes", return_value=[]) as begun:
        found = refits_of_likely(scores, afar, augmented, calm, objective, 5, CREW)
        # What is akin to it is refitted from its null where it was not looked at.
        refits_of_likely(scores, afar[:1], augmented, calm, objective, 5, CREW)
    assert {refit.cause.name for refit in found} == {"seen", "akin"}
    assert begun.call_args_list[-1].args[0] == [scores[1]]


@pytest.mark.parametrize("bent", [True, False])
def test_what_has_begun_where_it_shows_neither_begins_elsewhere_nor_measures_others(
    monkeypatch: pytest.MonkeyPatch, bent: bool
) -> None:
    """It has stalled, explains half, and its cost is under another correction."""
    objective, baseline, augmented, tried = large_effect("Q", 60.0)
    (done,) = refits_of_likely(tried[:1], (), augmented, baseline.best, objective, 1, CREW)
    apart = under_its_own_correction(done, replace(done.cause, name="apart"))
    other = replace(tried[0], cause=replace(done.cause, name="other"), p=1e-4, log_evidence=2.0)
    unseen = under_its_own_correction(done, replace(done.cause, name="unseen"))
    scores = [
        replace(other, cause=apart.cause, log_evidence=9.0),
        other,
        replace(
            other,
            cause=unseen.cause,
            p=0.5,
            log_evidence=1.5,
            directions=np.zeros_like(other.directions),
        ),
    ]
    here = replace(baseline.best, n_load=0) if bent else baseline.best
    monkeypatch.setattr(candidate_selection, "_bent", lambda *_: bent)
    monkeypatch.setattr(candidate_selection, "is_far_from_its_end", lambda refit: True)
    monkeypatch.setattr(candidate_selection, "_explained", lambda *_: bent)
    monkeypatch.setattr(candidate_selection, "refit_by_noise_continuation", lambda *_: [])
    promised = candidate_selection.cost_to_promise([], here)
    with (
        patch.object(candidate_selection, "refit_causes", return_value=[]) as from_null,
        patch.object(candidate_selection, "refit_from_afar", return_value=[]) as elsewhere,
    ):
        found = refits_of_likely(scores, [apart, unseen], augmented, here, objective, 3, CREW)
    assert {refit.cause.name for refit in found} == {"apart", "unseen"} and not elsewhere.called
    first, again = from_null.call_args_list
    assert first.args[0] == again.args[0] == [other]
    # The loads of a large effect ask for half of what the best gains, this one apart.
    assert bent or again.args[-1] == promised


def test_a_large_effect_that_refits_from_the_baseline_explain_needs_no_soft_loads() -> None:
    objective, baseline, augmented, tried = large_effect("Q", 60.0)
    assert baseline.best.chi_load > LARGE
    with patch.object(candidate_selection, "refit_by_noise_continuation", None):
        found = refits_of_likely(tried, (), augmented, baseline.best, objective, 5, CREW)
    assert found[0].cause.name == "isotropic_hardening"


def test_a_refit_that_ran_out_of_iterations_beside_its_optimum_needs_no_other_start() -> None:
    objective, baseline, augmented, tried = large_effect("Q", 60.0)
    done = refits_of_likely(tried, (), augmented, baseline.best, objective, 5, CREW)[0]
    assert done.fit.converged
    ran_out = replace(done, fit=replace(done.fit, converged=False))
    assert not is_far_from_its_end(ran_out)
    begin = done.objective.restrict(augmented, done.fit.best.free)
    stalled = replace(done, fit=replace(done.fit, best=begin, converged=False))
    assert is_far_from_its_end(stalled)
    assert not is_far_from_its_end(replace(stalled, fit=replace(stalled.fit, converged=True)))


@pytest.mark.parametrize(
    ("bent", "most", "with_it"),
    [
        (False, 1, ()),
        (True, 1, ("seen",)),
        (True, 2, ("seen", "worth")),
        (True, 3, ("seen", "worth")),
    ],
)
def test_where_the_best_refit_is_another_one_than_its_score_all_that_are_likely_are_refitted(
    bent: bool, most: int, with_it: tuple[str, ...]
) -> None:
    wanted = ("tilt_drift", "magnification_drift", "end_rotation", "height_scale")
    made = closed_form.objective(BENCH, BENCH.truth | {"tilt_drift": 4e-4})
    objective, baseline = identified(BENCH, made)
    causes, names = screened(objective.model, baseline.best.free, wanted)
    augmented = objective.evaluate(baseline.values, names)
    effects = effects_of(causes, augmented, objective.parameters)
    scores = [score(c, e, baseline.best, len(causes)) for c, e in zip(causes, effects, strict=True)]
    best, *others = sorted(scores, key=lambda one: -one.log_evidence)
    # Far behind one is worth adding, one is not, and one is seen whatever it is worth.
    likely = {"worth": (1.1, 0.1), "not": (0.9, 0.1), "seen": (0.8, 1e-4)}
    behind = {
        what: replace(other, log_evidence=evidence, p=p)
        for other, (what, (evidence, p)) in zip(others, likely.items(), strict=True)
    }
    tried = [best, *behind.values()]
    with patch.object(candidate_selection, "_bent", lambda *arguments: bent):
        found = refits_of_likely(tried, (), augmented, baseline.best, objective, most, CREW)
    expected = {best.cause.name, *(behind[what].cause.name for what in with_it)}
    assert {refit.cause.name for refit in found} == expected
