from __future__ import annotations

from dataclasses import replace

import pytest

from driver.diagnosis.causes import LIBRARY
from driver.diagnosis.diagnose import diagnose
from driver.diagnosis.outcome import Settings
from driver.diagnosis.score import effects_of
from driver.diagnosis.screening import screen, screened
from tests.driver import closed_form

BENCH = closed_form.bench()


def test_scores_of_small_effects_are_what_a_refit_finds() -> None:
    made = closed_form.objective(BENCH, BENCH.truth | {"tilt_drift": 4e-4})
    fine = replace(BENCH.model, adapter=closed_form.ClosedFormSolver(0.001))
    objective, baseline = closed_form.identified(BENCH, made, fine)
    cause = next(c for c in LIBRARY if c.name == "tilt_drift")
    candidates, names = screened(objective.model, baseline.best.free, ("tilt_drift",))
    assert candidates == (cause,) and names == (*baseline.best.free, "tilt_drift")
    wide = objective.evaluate(baseline.values, names)
    effects = effects_of(candidates, wide, objective.parameters)
    scores, _ = screen(baseline, objective, candidates, effects, closed_form.SIZES)
    score = next(s for s in scores if s.cause is cause)
    settings = Settings(
        wanted=("tilt_drift",), refit=5, held_out=None, processes=1, threads=1, free_chi=1.0,
        sizes=closed_form.SIZES,
    )  # fmt: skip
    found = diagnose(baseline, objective, fine, BENCH.history.cycle, settings, lambda line: None)
    (refit,) = found.steps[0].refits
    assert refit.log_evidence == pytest.approx(score.log_evidence, rel=0.05)
    scale = objective.parameters["tilt_drift"].scale
    assert refit.fit.values["tilt_drift"] / scale == pytest.approx(score.estimate[0], rel=0.05)
