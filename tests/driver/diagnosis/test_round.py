from __future__ import annotations

from dataclasses import replace

from driver.diagnosis.causes import NUMERICS
from driver.diagnosis.omnibus import FAMILY_LEVEL
from driver.diagnosis.outcome import Settings
from driver.diagnosis.round import WORTH, examine
from driver.identification.fit import Fit, Objective
from tests.driver import closed_form

BENCH = closed_form.bench()
SETTINGS = Settings(
    wanted=("tilt_drift",), refit=5, held_out=None, processes=1, threads=1, free_chi=1.0,
    sizes=closed_form.SIZES,
)  # fmt: skip


FINE = replace(BENCH.model, adapter=closed_form.ClosedFormSolver(0.001))


def identified(hidden: dict[str, float]) -> tuple[Objective, Fit]:
    made = closed_form.objective(BENCH, BENCH.truth | hidden)
    return closed_form.identified(BENCH, made, FINE)


def test_once_one_cause_is_seen_the_best_by_evidence_are_refitted_and_no_others() -> None:
    objective, baseline = identified({"tilt_drift": 4e-4})
    every = replace(SETTINGS, wanted=None)
    step, winner = examine(baseline, objective, (), every, None, lambda line: None)
    assert [s.cause.name for s in step.scores if s.p < FAMILY_LEVEL] == ["tilt_drift"]
    best = [s.cause.name for s in step.scores if s.cause.name != NUMERICS.name][: every.refit]
    assert {refit.cause.name for refit in step.refits} == set(best)
    assert winner is not None and winner.cause.name == "tilt_drift"


def test_an_effect_far_beyond_its_prior_is_significant_and_still_not_added() -> None:
    objective, baseline = identified({"tilt_drift": 4e-4})
    _, winner = examine(baseline, objective, (), SETTINGS, None, lambda line: None)
    assert winner is not None and winner.cause.name == "tilt_drift"
    usual = objective.parameters["tilt_drift"]
    # Of this size nobody expects it: forty of its prior scales.
    narrow = dict(objective.parameters) | {"tilt_drift": replace(usual, scale=1e-5)}
    objective = replace(objective, parameters=narrow)
    step, winner = examine(baseline, objective, (), SETTINGS, None, lambda line: None)
    (refit,) = step.refits
    assert step.scores[0].p < FAMILY_LEVEL and 0 < refit.log_evidence < WORTH
    assert winner is None and step.named == ()
