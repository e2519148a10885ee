"""Identification and diagnosis of the specimen in closed form, as a run does them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from unittest.mock import patch

import numpy as np

from driver.diagnosis.answer.result_types import Diagnosis, Settings
from driver.diagnosis.causes.causes import NUMERICS
from driver.diagnosis.causes.noise_causes import COVARIANCE
from driver.diagnosis.search.diagnose import diagnose
from driver.diagnosis.search.fine_models import FineModels
from driver.diagnosis.statistics.score_test import Score, score
from driver.diagnosis.statistics.screening import screened
from driver.forward.model import ForwardModel
from driver.identification.correction import correction
from driver.identification.fit import Fit, fit
from driver.identification.identify import with_correction
from driver.identification.objective import Evaluation, Objective
from driver.identification.priors import LAMBDA_PRIOR
from driver.parameters.boundary import LAMBDAS, elongation_names, tilt_names
from driver.parameters.pose import POSE_DECLARATIONS
from driver.parameters.registry import declared_parameters
from tools import closed_form
from tools.closed_form import KNOTS, LAW, SIZES, ClosedFormSolver, ClosedFormSpecimen, problem

PRECISE = 0.2  # µN
SETTINGS = Settings(
    wanted=None, refit=3, held_out=None, processes=1, threads=1, free_chi=1.0, sizes=SIZES
)
"""What a test asks of a diagnosis unless it says otherwise."""


def finer(b: ClosedFormSpecimen, by: float = 0.001) -> ForwardModel:
    """Return the model of a finer simulation, another by so much (`ClosedFormSolver`)."""
    solver = b.model.adapter
    assert isinstance(solver, ClosedFormSolver)
    return replace(b.model, adapter=type(solver)(by))


def priors(start: Mapping[str, float]) -> dict[str, tuple[float, float]]:
    """Priors of the apex amplitudes, of the law and of the pose, as in a run."""
    parameters = declared_parameters(len(KNOTS) + 1)
    prior = {name: (start[name], LAMBDA_PRIOR / parameters[name].scale) for name in LAMBDAS}
    prior |= {name: (start[name], 1.0) for name in LAW}
    return prior | {p.name: (0.0, 1.0) for p in POSE_DECLARATIONS}


def identified(
    b: ClosedFormSpecimen,
    made_with: Objective,
    sizes: tuple[float, float] = SIZES,
    by: float = 0.001,
) -> tuple[Objective, Fit]:
    """Return the baseline of a diagnosis: all but the extensions fitted, with the correction.

    Args:
        b: the specimen.
        made_with: objective of the data.
        sizes: of the elements of the working and of the finer mesh, as they are told [µm].
        by: by how much the finer simulation is another one (`finer`).
    """
    n = len(KNOTS) + 1
    pose = tuple(p.name for p in POSE_DECLARATIONS)
    free = (*LAMBDAS, *pose, *elongation_names(n), *tilt_names(n), *LAW)
    start = replace(made_with, prior=priors(b.truth))
    first = fit(start, b.truth, free, 12)
    change = correction(b.model, finer(b, by), first.best.prediction, first.values)
    corrected = with_correction(start, 1.0, change, sizes)
    return corrected, fit(corrected, first.values, free, 12)


def diagnosis_of(
    b: ClosedFormSpecimen,
    baseline: tuple[Objective, Fit],
    settings: Settings = SETTINGS,
    by: float = 0.001,
) -> Diagnosis:
    """Return what is wrong with a baseline (`identified`)."""
    objective, fitted = baseline
    meshes = FineModels(finer(b, by))
    return diagnose(fitted, objective, meshes, b.history.cycle, settings)


@cache
def large_effect(name: str, value: float) -> tuple[Objective, Fit, Evaluation, list[Score]]:
    """Return experiment below a precise load cell, and all causes, the best by their scores first.

    Effects are hundreds of times as large as its noise.
    """
    b = problem()
    with patch.object(closed_form, "LOAD_NOISE", PRECISE):
        made = closed_form.objective(b, b.truth | {name: value})
        objective, baseline = identified(b, made)
    at = baseline.best
    causes, names = screened(objective.model, at.free, None)
    augmented = objective.evaluate(baseline.values, names)
    rows = dict(zip(augmented.free, augmented.jacobian, strict=True))
    scores = [
        score(cause, np.array([rows[name] for name in cause.parameters]), at, len(causes))
        for cause in causes
        if cause != NUMERICS and cause not in COVARIANCE
    ]
    tried = [one for one in scores if one.degrees]
    return objective, baseline, augmented, sorted(tried, key=lambda one: -one.log_evidence)
