from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from driver.diagnosis import round as round_module
from driver.diagnosis.boundary_noise import Stops
from driver.diagnosis.causes import Cause
from driver.diagnosis.finer_meshes import FinerMeshes
from driver.diagnosis.round import examine, to_refit
from driver.diagnosis.score import NAMING_LEVEL, WORTH, Score
from driver.diagnosis.screening import screen
from driver.identification.fit import Fit
from driver.identification.objective import Objective
from driver.log import silent
from tests.driver import closed_form
from tests.driver.closed_form_diagnosis import SETTINGS, finer, identified

BENCH = closed_form.bench()
EVERY = replace(SETTINGS, refit=5)
TILT = replace(EVERY, wanted=("tilt_drift",))
NO_STOPS = Stops(None)
FINER = FinerMeshes(finer(BENCH))


def tilting() -> tuple[Objective, Fit]:
    return identified(BENCH, closed_form.objective(BENCH, BENCH.truth | {"tilt_drift": 4e-4}))


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


def test_of_a_small_effect_that_its_cause_explains_no_other_cause_is_refitted() -> None:
    objective, baseline = tilting()
    found = examine(baseline, objective, (), EVERY, NO_STOPS, None, FINER, silent)
    assert found.winner is not None and found.winner.cause.name == "tilt_drift"
    assert len(found.step.refits) == 1


def unlikely(
    here: Fit, objective: Objective, candidates: Sequence[Cause], *others: Any
) -> tuple[list[Score], float]:
    """Scores of which none is significant."""
    scores, variance = screen(here, objective, candidates, *others)
    return [replace(s, p=1.5 * NAMING_LEVEL) for s in scores], variance


def test_where_the_tests_reject_what_promises_most_is_refitted_though_none_is_significant(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    objective, baseline = tilting()
    monkeypatch.setattr(round_module, "screen", unlikely)
    found = examine(baseline, objective, (), EVERY, NO_STOPS, None, FINER, silent)
    assert not found.step.omnibus.accepted
    assert found.winner is not None and found.winner.cause.name == "tilt_drift"
    hopeful = [s.cause for s in found.step.scores if s.log_evidence > WORTH and s.degrees]
    assert {r.cause for r in found.step.refits} == set(hopeful[: EVERY.refit])


def test_where_the_tests_accept_and_none_is_significant_nothing_is_refitted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(round_module, "screen", unlikely)
    objective, baseline = identified(BENCH, closed_form.objective(BENCH, BENCH.truth))
    found = examine(baseline, objective, (), EVERY, NO_STOPS, None, FINER, silent)
    assert found.step.omnibus.accepted and found.step.refits == ()


def test_an_effect_far_beyond_its_prior_is_significant_and_still_not_added() -> None:
    objective, baseline = tilting()
    found = examine(baseline, objective, (), TILT, NO_STOPS, None, FINER, silent)
    assert found.winner is not None and found.winner.cause.name == "tilt_drift"
    usual = objective.parameters["tilt_drift"]
    # Of this size nobody expects it: forty of its prior scales.
    narrow = dict(objective.parameters) | {"tilt_drift": replace(usual, scale=1e-5)}
    objective = replace(objective, parameters=narrow)
    found = examine(baseline, objective, (), TILT, NO_STOPS, None, FINER, silent)
    (refit,) = found.step.refits
    assert found.step.scores[0].p < NAMING_LEVEL and 0 < refit.log_evidence < WORTH
    assert found.winner is None and found.step.named == ()
