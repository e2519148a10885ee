"""The model with one more cause: its own correction and noise, fitted, and pruned."""

from __future__ import annotations

import logging
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np

from driver.diagnosis.answer.result_types import GATE, Refit, Settings
from driver.diagnosis.causes.causes import Cause
from driver.diagnosis.causes.noise_causes import BOUNDARY_NOISE
from driver.diagnosis.search.backward_elimination import eliminate
from driver.diagnosis.search.baseline import noise_of_images, with_load_noise
from driver.diagnosis.search.boundary_noise import Level, level_again
from driver.diagnosis.search.fine_models import FineModels
from driver.diagnosis.search.load_outliers import bad_loads
from driver.diagnosis.search.refit import Executor
from driver.diagnosis.statistics.correction_change import (
    changed_on_the_way,
    whitened_difference,
)
from driver.identification.correction import Correction
from driver.identification.fit import POLISH, Fit, fit_from
from driver.identification.identify import with_correction
from driver.identification.objective import Objective

logger = logging.getLogger(__name__)

_FAR = 30.0
"""σ by which a prediction may move from where its correction was taken: a correction has changed
by a hundredth of what the prediction moved by, and the discretisation check lets 1 σ pass."""
_MOST_CORRECTIONS = 3  # of one extended model


@dataclass(frozen=True, eq=False)
class Extension:
    """A model as far as it was extended.

    Attributes:
        fit: the fit.
        objective: its objective.
        finer: the finer models, their orientations those of the fit.
        causes: the causes that were added and are still needed.
        levels: of the noise that was named its level and the standard deviation of it.
        of_noise: log evidence of that noise.
        fitted: what is fitted without any cause.
        surpassed: the causes of each model to which another one was added on the way here.
    """

    fit: Fit
    objective: Objective
    finer: FineModels
    causes: tuple[Cause, ...]
    levels: Mapping[str, Level]
    of_noise: float
    fitted: tuple[str, ...]
    surpassed: tuple[frozenset[Cause], ...]


def extended(before: Extension, winner: Refit, settings: Settings) -> Extension:
    """Return the model with a cause added, and without what that makes superfluous.

    Args:
        before: the model without it.
        winner: the refit of the cause, from that model.
        settings: how the diagnosis is run.

    Raises:
        SolverError: the simulation could not be finished.
    """
    finer = before.finer.turned((winner.cause,))
    fitted, objective = winner.fit, winner.objective
    levels: Mapping[str, Level] = {**before.levels, **winner.levels}
    for again in range(_MOST_CORRECTIONS):
        if again:
            logger.info("the correction is another one at this fit: once more with that")
        begin = fitted
        objective = _corrected(objective, begin, finer, settings)
        fitted, objective, levels = _fitted(begin, objective, levels)
        if not _outgrown(objective, begin, fitted):
            break
    surpassed = (*before.surpassed, frozenset(before.causes))
    noise = winner.log_evidence if winner.levels else before.of_noise
    after = replace(
        before, fit=fitted, objective=objective, finer=finer, levels=levels, of_noise=noise,
        causes=(*before.causes, winner.cause), surpassed=surpassed,
    )  # fmt: skip
    return _pruned(after, surpassed)


def corrected_anew(here: Extension, settings: Settings) -> Extension:
    """Return the model fitted once more with the correction at its own end.

    What was found with another correction counts no more: each cause is tested anew.

    Args:
        here: the model.
        settings: how the diagnosis is run.

    Raises:
        SolverError: the finer simulation could not be finished.
    """
    objective = _corrected(here.objective, here.fit, here.finer, settings)
    fitted, objective, levels = _fitted(here.fit, objective, here.levels)
    return _pruned(replace(here, fit=fitted, objective=objective, levels=levels), None)


def _pruned(here: Extension, surpassed: Collection[frozenset[Cause]] | None) -> Extension:
    """Return the model without the causes that are not needed any more (`eliminate`)."""
    if BOUNDARY_NOISE in here.causes and not here.levels:
        left = tuple(cause for cause in here.causes if cause != BOUNDARY_NOISE)
        here = replace(here, causes=left, of_noise=0.0)
    fitted, objective, causes = eliminate(
        here.fit, here.objective, here.causes, here.fitted, surpassed
    )
    return replace(here, fit=fitted, objective=objective, causes=tuple(causes))


def _outgrown(objective: Objective, begin: Fit, end: Fit) -> bool:
    """Whether a fit ends where its correction, taken at another one, holds no more.

    Either the prediction has moved far, or the correction has changed by its derivatives so that a
    score may have moved by more than the discretisation check lets pass: on coarse cells they leave
    as much out as they hold.
    """
    before, other = (
        Correction(f.best.prediction.motion, f.best.prediction.load) for f in (begin, end)
    )
    moved = float(np.linalg.norm(whitened_difference(objective, other, before)))
    return moved >= _FAR or changed_on_the_way(objective, begin.values, end.best) >= GATE


def _corrected(objective: Objective, here: Fit, finer: FineModels, settings: Settings) -> Objective:
    """Return the objective with the correction at a fit, by both meshes where it had both.

    What a second mesh took away stays away where it cannot be simulated here.
    """
    logger.info("finer mesh and steps at the extended model")
    both, executor = objective.second is not None, Executor(settings.processes, settings.threads)
    change, second = finer.corrections(objective, here, both, executor)
    noise = noise_of_images(here, objective.data, settings)
    if both and second is None:
        logger.info("  what the second mesh adds is that at the fit before")
        second = objective.second
    change = change.completed_by(objective.correction)
    return with_correction(objective, noise, change, settings.sizes, second)


def _fitted(
    begin: Fit, objective: Objective, levels: Mapping[str, Level]
) -> tuple[Fit, Objective, Mapping[str, Level]]:
    """Return the extended model fitted with its own noise, and the level of the latter.

    A load that was left out and that the extended model explains is taken back.
    """
    fitted = fit_from(begin.best, objective, POLISH)
    free, data = fitted.best.free, objective.data
    if data.bad_loads:
        whole = replace(objective, data=replace(data, bad_loads=()))
        again = whole.compare(fitted.best.prediction, fitted.values, free)
        still = {outlier.frame for outlier in bad_loads(again, whole.data)} & set(data.bad_loads)
        data = replace(data, bad_loads=tuple(sorted(still)))
        objective = replace(objective, data=data)
    at = objective.compare(fitted.best.prediction, fitted.values, free)
    if levels:
        objective, levels = level_again(at, objective, levels)
        at = objective.compare(fitted.best.prediction, fitted.values, free)
    objective = replace(objective, data=with_load_noise(objective.data, at))
    return fit_from(at, objective, POLISH), objective, levels
