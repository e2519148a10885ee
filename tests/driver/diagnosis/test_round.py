from __future__ import annotations

from dataclasses import replace

from driver.diagnosis.omnibus import FAMILY_LEVEL
from driver.diagnosis.outcome import Settings
from driver.diagnosis.round import WORTH, examine
from tests.driver import closed_form

BENCH = closed_form.bench()
SETTINGS = Settings(
    wanted=("tilt_drift",), refit=5, held_out=None, processes=1, threads=1, free_chi=1.0,
    sizes=closed_form.SIZES,
)  # fmt: skip


def test_an_effect_far_beyond_its_prior_is_significant_and_still_not_added() -> None:
    made = closed_form.objective(BENCH, BENCH.truth | {"tilt_drift": 4e-4})
    fine = replace(BENCH.model, adapter=closed_form.ClosedFormSolver(0.001))
    objective, baseline = closed_form.identified(BENCH, made, fine)
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
