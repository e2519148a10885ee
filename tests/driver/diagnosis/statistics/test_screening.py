from __future__ import annotations

from dataclasses import replace

import pytest

from driver.diagnosis.causes.causes import LIBRARY
from driver.diagnosis.statistics.score_test import effects_of
from driver.diagnosis.statistics.screening import screen, screened
from tools import closed_form
from tools.closed_form_diagnosis import SETTINGS, diagnosis_of, identified

BENCH = closed_form.problem()


def test_scores_of_small_effects_are_what_a_refit_finds() -> None:
    made = closed_form.objective(BENCH, BENCH.truth | {"tilt_drift": 4e-4})
    objective, baseline = identified(BENCH, made)
    cause = next(c for c in LIBRARY if c.name == "tilt_drift")
    candidates, names = screened(objective.model, baseline.best.free, ("tilt_drift",))
    assert candidates == (cause,) and names == (*baseline.best.free, "tilt_drift")
    augmented = objective.evaluate(baseline.values, names)
    effects = effects_of(candidates, augmented, objective.parameters)
    scores, _ = screen(baseline, objective, candidates, effects, closed_form.SIZES)
    score = next(s for s in scores if s.cause is cause)
    settings = replace(SETTINGS, wanted=("tilt_drift",))
    found = diagnosis_of(BENCH, (objective, baseline), settings)
    (refit,) = found.rounds[0].refits
    assert refit.log_evidence == pytest.approx(score.log_evidence, rel=0.05)
    scale = objective.parameters["tilt_drift"].scale
    assert refit.fit.values["tilt_drift"] / scale == pytest.approx(score.estimate[0], rel=0.05)
