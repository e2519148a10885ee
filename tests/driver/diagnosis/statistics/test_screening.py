from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from driver.diagnosis.causes.causes import LIBRARY, NUMERICS
from driver.diagnosis.statistics.score_test import effects_of
from driver.diagnosis.statistics.screening import (
    off_by_meshes,
    own_error_shapes,
    parameters_of_the_specimen,
    screen,
    screened,
)
from driver.identification.correction import Correction, SecondMesh
from solver_adapters.crystal import BCC, BCC48, FCC
from solver_adapters.material import of_other_crystals
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


def test_causes_that_only_bcc_has_are_not_examined_in_another_crystal() -> None:
    bcc = BENCH.model
    fcc, bcc48 = (
        replace(bcc, material=replace(bcc.material, slip_systems=systems))
        for systems in (FCC, BCC48)
    )
    candidates = [{cause.name for cause in screened(m, (), None)[0]} for m in (bcc, fcc, bcc48)]
    assert candidates[0] - candidates[1] == {"family_112", "twinning_asymmetry", "non_schmid"}
    assert candidates[2] - candidates[0] == {"family_123"}
    lost = parameters_of_the_specimen(bcc) - parameters_of_the_specimen(fcc)
    assert lost == of_other_crystals(FCC) - of_other_crystals(BCC)


def test_without_a_correction_neither_the_discretisation_nor_what_it_leaves_is_scored() -> None:
    objective, fitted = identified(BENCH, closed_form.objective(BENCH, BENCH.truth))
    candidates, names = screened(objective.model, fitted.best.free, ("tilt_drift",))
    augmented = objective.evaluate(fitted.values, names)
    effects = effects_of(candidates, augmented, objective.parameters)
    found = [
        screen(fitted, replace(objective, correction=change), candidates, effects, SETTINGS.sizes)
        for change in (objective.correction, Correction())
    ]
    scored = [{s.cause.name for s in scores} for scores, _ in found]
    assert scored == [{"tilt_drift", NUMERICS.name}, {"tilt_drift"}]
    assert found[1][1] == 1.0


def test_what_a_better_second_mesh_leaves_is_less_and_only_equals_are_off_by_each_other() -> None:
    objective, fitted = identified(BENCH, closed_form.objective(BENCH, BENCH.truth))
    candidates, names = screened(objective.model, fitted.best.free, ("grain_contrast",))
    effects = effects_of(candidates, objective.evaluate(fitted.values, names), objective.parameters)
    # A correction that looks like the cause.
    other, same = (
        objective.model.predict(fitted.values | {"tau0_grain2": ratio}) for ratio in (1.5, 1.0)
    )
    motion = other.motion - same.motion
    large = replace(objective, correction=replace(objective.correction, motion=motion))
    apart = Correction(1e-3 * np.ones_like(motion), np.ones(len(motion)))
    widened, shapes, off = {}, {}, {}
    for name, second in (
        ("one", None), ("equals", SecondMesh(apart)), ("better", SecondMesh(apart, 0.1))
    ):  # fmt: skip
        here = replace(large, second=second)
        _, widened[name] = screen(fitted, here, candidates, effects, SETTINGS.sizes)
        shapes[name], off[name] = len(own_error_shapes(here)), off_by_meshes(here)
    assert widened["one"] == widened["equals"] > 1.2 * widened["better"]
    assert shapes == {"one": 1, "equals": 2, "better": 1}
    assert off["one"] is None and off["better"] is None and off["equals"] is not None
