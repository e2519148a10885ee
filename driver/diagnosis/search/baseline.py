"""The baseline made fit for a diagnosis: bad loads left out, noise as found, converged."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace

from driver.diagnosis.answer.result_types import BadLoad, Settings
from driver.diagnosis.causes.candidates import NotExamined
from driver.diagnosis.causes.causes import Cause
from driver.diagnosis.search.boundary_noise import (
    BoundaryNoiseSensitivities,
    explains_better,
    score_boundary_noise,
)
from driver.diagnosis.search.image_noise import Unevenness, examine_noise
from driver.diagnosis.search.load_outliers import bad_loads, load_noise
from driver.diagnosis.search.refit import TOLERANCE
from driver.diagnosis.statistics.goodness_of_fit import FAMILY_LEVEL
from driver.diagnosis.statistics.score_test import effects_of
from driver.identification.data import Data
from driver.identification.fit import POLISH, Fit, fit_from
from driver.identification.identify import noise_factor, with_correction
from driver.identification.image_data import reweighted
from driver.identification.objective import Evaluation, Objective

logger = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Prepared:
    """What screening begins with.

    Attributes:
        baseline: the fit to examine.
        objective: its objective.
        augmented: evaluation there with the parameters of every cause free, None if unknown.
        bad: the loads that were left out.
        uneven: how the noise varies over the pixels, None where that was not asked.
        left: the cause that was not asked for, if any.
    """

    baseline: Fit
    objective: Objective
    augmented: Evaluation | None
    bad: tuple[BadLoad, ...]
    uneven: Unevenness | None
    left: tuple[NotExamined, ...]


def prepared(
    baseline: Fit,
    objective: Objective,
    augmented: Evaluation,
    candidates: Sequence[Cause],
    settings: Settings,
) -> Prepared:
    """Leave out loads that are wrong one by one, take the noise that is there, and fit again.

    Args:
        baseline: the fit.
        objective: its objective.
        augmented: evaluation at the fit with the parameters of every candidate free.
        candidates: the causes.
        settings: how the diagnosis is run.

    Raises:
        SolverError: a simulation could not be finished.
    """
    effects = effects_of(candidates, augmented, objective.parameters)
    bad = bad_loads(baseline.best, objective.data, effects)
    free, fitted = baseline.best.free, baseline
    if bad:
        for outlier in bad:
            logger.info(
                f"  the load of image {outlier.frame} is off by {outlier.off:+.3g} µN "
                f"({outlier.sigmas:+.1f} σ): it is left out"
            )
        data = replace(objective.data, bad_loads=tuple(outlier.frame for outlier in bad))
        objective = replace(objective, data=data)
        fitted = _fitted_again(objective, fitted)
    objective = replace(objective, data=with_load_noise(objective.data, fitted.best))
    if settings.imaging_limited:
        image = objective.data.image
        louder = replace(image, noise_factor=max(image.noise_factor, settings.free_chi))
        objective = replace(objective, data=replace(objective.data, image=louder))
    fitted = _fitted_again(objective, fitted)
    uneven = examine_noise(fitted.best, objective.data, settings.wanted, objective.model.n_grains)
    left = (uneven,) if isinstance(uneven, NotExamined) else ()
    uneven = uneven if isinstance(uneven, Unevenness) else None
    if uneven is not None and uneven.named:
        logger.info(
            f"the noise of the images is uneven, by a factor of {uneven.ratio:.2f}: re-weighted"
        )
        objective = _reweighted(objective, fitted, uneven, settings)
        fitted = _fitted_again(objective, fitted)
    moved = fitted.values != baseline.values
    known = (
        None if moved else objective.compare(augmented.prediction, augmented.values, augmented.free)
    )
    fitted = replace(fitted, best=objective.restrict(fitted.best, free))
    return Prepared(fitted, objective, known, bad, uneven, left)


def loads_taken_back(
    begin: Prepared,
    stops: BoundaryNoiseSensitivities,
    candidates: Sequence[Cause],
    names: Sequence[str],
) -> Prepared:
    """Return the same with the loads that were left out, where noise of the boundary explains them.

    It has to be seen with them, and to be likelier than errors of their own.

    Args:
        begin: what screening would begin with.
        stops: the answers to each stop, if they were computed.
        candidates: the causes.
        names: the parameters that screening needs free.

    Raises:
        SolverError: the simulation could not be finished.
    """
    if stops.effect is None or not begin.bad:
        return begin
    objective, fitted = begin.objective, begin.baseline
    whole = replace(objective, data=replace(objective.data, bad_loads=()))
    at = whole.compare(fitted.best.prediction, fitted.values, fitted.best.free)
    if not explains_better(stops.effect, at, whole.data, [outlier.frame for outlier in begin.bad]):
        return begin
    logger.info("  a noise of the boundary explains the loads that were left out better: with them")
    fitted = _fitted_again(whole, fitted)
    whole = replace(whole, data=with_load_noise(whole.data, fitted.best))
    fitted = _fitted_again(whole, fitted)
    augmented = whole.with_free(fitted.best, names)
    effects = effects_of(candidates, augmented, whole.parameters)
    noise = score_boundary_noise(stops.effect, fitted.best, whole.data, effects, len(effects) + 2)
    if noise.p >= FAMILY_LEVEL:
        logger.info(f"  it is not seen with any cause free (p {noise.p:.2g}): they stay left out")
        return begin
    return replace(begin, baseline=fitted, objective=whole, augmented=augmented, bad=())


def _reweighted(
    objective: Objective, here: Fit, uneven: Unevenness, settings: Settings
) -> Objective:
    """Return objective with each pixel counted by its own noise, and their level as it then is."""
    image = reweighted(objective.data.image, uneven.variance)
    data = replace(objective.data, image=image, simulation_error=None, step_error=None)
    weighed = replace(objective, data=data)
    there = replace(here, best=weighed.compare(here.best.prediction, here.values, here.best.free))
    noise = noise_of_images(there, data, settings)
    return with_correction(weighed, noise, objective.correction, settings.sizes)


def noise_of_images(fit_: Fit, data: Data, settings: Settings) -> float:
    """Noise of the images over that of the repeats, imaging errors of free correlation counted."""
    noise = data.image.noise_factor * noise_factor(fit_, data)
    return max(noise, settings.free_chi) if settings.imaging_limited else noise


def with_load_noise(data: Data, fitted: Evaluation) -> Data:
    """Return the data with the noise that the loads of a fit have, and its degrees of freedom."""
    factor, degrees = load_noise(fitted, data)
    noise = factor * data.load_noise
    if factor != 1.0:
        logger.info(
            f"  noise of the loads {noise:.3g} µN, {factor:.2f} of that before, "
            f"by {degrees:.0f} degrees of freedom"
        )
    return replace(data, load_noise=noise, load_degrees=degrees)


def _fitted_again(objective: Objective, here: Fit) -> Fit:
    # Scores are taken at the optimum to first order: a fit this near to it needs no
    # step, and the sensitivities of all causes, known there already, are not simulated again.
    return fit_from(here.best, objective, POLISH, TOLERANCE)
