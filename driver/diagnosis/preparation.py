"""The baseline made fit for a diagnosis: bad loads left out, noise as found, converged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from driver.diagnosis.causes import Cause
from driver.diagnosis.loads import BadLoad, bad_loads, load_noise
from driver.diagnosis.outcome import Log, Settings
from driver.diagnosis.refit import TOLERANCE
from driver.diagnosis.score import prior_scaled
from driver.identification.data import Data
from driver.identification.fit import Evaluation, Fit, Objective, fit
from driver.identification.procedure import noise_factor

MOST_ITERATIONS = 8


@dataclass(frozen=True, eq=False)
class Prepared:
    """What screening begins with.

    Attributes:
        baseline: the fit to examine.
        objective: its objective.
        wide: evaluation there with the parameters of every cause free, None if unknown.
        bad: the loads that were left out.
    """

    baseline: Fit
    objective: Objective
    wide: Evaluation | None
    bad: tuple[BadLoad, ...]


def prepared(
    baseline: Fit,
    objective: Objective,
    wide: Evaluation,
    candidates: Sequence[Cause],
    settings: Settings,
    log: Log,
) -> Prepared:
    """Leave out loads that are wrong one by one, take the noise that is there, and fit again.

    Args:
        baseline: the fit.
        objective: its objective.
        wide: evaluation at the fit with the parameters of every candidate free.
        candidates: the causes.
        settings: how the diagnosis is run.
        log: takes one line of progress.
    """
    effects = [
        prior_scaled(
            wide.jacobian[[wide.free.index(name) for name in cause.parameters]],
            cause.parameters, objective.parameters,
        )
        for cause in candidates
    ]  # fmt: skip
    bad = bad_loads(baseline.best, objective.data, effects)
    free, here = baseline.best.free, baseline
    if bad:
        for one in bad:
            log(f"  the load of image {one.frame} is off by {one.off:+.3g} µN "
                f"({one.sigmas:+.1f} σ): it is left out")  # fmt: skip
        data = replace(objective.data, bad_loads=tuple(one.frame for one in bad))
        objective = replace(objective, data=data)
        here = _fitted_again(objective, here, log)
    objective = replace(objective, data=with_load_noise(objective.data, here.best, log))
    if settings.imaging_limited:
        image = objective.data.image
        louder = replace(image, noise_factor=max(image.noise_factor, settings.free_chi))
        objective = replace(objective, data=replace(objective.data, image=louder))
    here = _fitted_again(objective, here, log)
    moved = here.values != baseline.values
    known = None if moved else objective.compare(wide.prediction, wide.values, wide.free)
    return Prepared(replace(here, best=objective.restrict(here.best, free)), objective, known, bad)


def noise_of_images(fit_: Fit, data: Data, settings: Settings) -> float:
    """Noise of the images over that of the repeats, imaging errors of free correlation counted."""
    noise = data.image.noise_factor * noise_factor(fit_, data)
    return max(noise, settings.free_chi) if settings.imaging_limited else noise


def with_load_noise(data: Data, fitted: Evaluation, log: Log) -> Data:
    """The data with the noise that the loads of a fit have, and its degrees of freedom."""
    factor, degrees = load_noise(fitted, data)
    noise = factor * data.load_noise
    if factor != 1.0:
        log(f"  noise of the loads {noise:.3g} µN, {factor:.2f} of that before, "
            f"by {degrees:.0f} degrees of freedom")  # fmt: skip
    return replace(data, load_noise=noise, load_degrees=degrees)


def _fitted_again(objective: Objective, here: Fit, log: Log) -> Fit:
    begin = objective.compare(here.best.prediction, here.values, here.best.free)
    # Scores and evidence are taken at the optimum to first order: a fit this near to it needs no
    # step, and the sensitivities of all causes, known there already, are not simulated again.
    return fit(
        objective, here.values, here.best.free, MOST_ITERATIONS, log, begin, tolerance=TOLERANCE
    )
