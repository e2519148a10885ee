"""Backward elimination: what later causes have made superfluous goes back to its null."""

from __future__ import annotations

import logging
from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from driver.common.distributions import chi2_sf
from driver.diagnosis.causes.causes import Cause
from driver.diagnosis.causes.noise_causes import COVARIANCE
from driver.diagnosis.statistics.goodness_of_fit import FAMILY_LEVEL
from driver.identification.fit import Fit, fit
from driver.identification.objective import Objective

logger = logging.getLogger(__name__)

_MOST_ITERATIONS = 5


def eliminate(
    here: Fit,
    objective: Objective,
    causes: Sequence[Cause],
    fitted: Collection[str],
    surpassed: Collection[frozenset[Cause]] | None,
) -> tuple[Fit, Objective, list[Cause]]:
    """Drop causes that are not needed, the least needed first, each time fitting anew.

    The last cause was only just needed, and is not tested; nor are noises, whose levels are
    estimated anew for each extended model. Nor does a cause go whose absence would lead back to a
    model from which evidence has led here: a Wald test, to first order, would undo that for ever.

    Args:
        here: the extended fit.
        objective: its objective.
        causes: the causes that were added, in the order of their addition.
        fitted: what is fitted without any of them.
        surpassed: the causes of each model to which another cause was added on the way here; None
            where what led here counts no more, and the last cause is tested as well.

    Returns:
        The fit, its objective and the causes that are left.

    Raises:
        SolverError: a simulation could not be finished.
    """
    left = list(causes)
    while tested := [
        cause
        for cause in (left if surpassed is None else left[:-1])
        if cause not in COVARIANCE and frozenset(left) - {cause} not in (surpassed or ())
    ]:
        p = [probability(here, objective, cause) for cause in tested]
        least = int(np.argmax(p))
        if p[least] < FAMILY_LEVEL:
            break
        cause = tested[least]
        left.remove(cause)
        logger.info(f"{cause.name} is not needed any more")
        needed = {name for other in left for name in (*other.parameters, *other.companions)}
        needed |= set(fitted)
        freed = [n for n in (*cause.parameters, *cause.companions) if n not in needed]
        null = objective.model.null_values()
        free = tuple(name for name in here.best.free if name not in freed)
        prior = {name: p for name, p in objective.prior.items() if name not in freed}
        objective = replace(objective, prior=prior)
        values = here.values | {name: null[name] for name in freed}
        here = fit(objective, values, free, _MOST_ITERATIONS)
    return here, objective, left


def probability(here: Fit, objective: Objective, cause: Cause) -> float:
    """Probability of parameters as far from their null, were the cause absent (Wald test).

    A flip of the EBSD frame has none: no small departure makes it superfluous.
    """
    if not cause.parameters:
        return 0.0
    null, names = objective.model.null_values(), cause.parameters
    rows = [here.best.free.index(name) for name in names]
    theta = np.array([objective.parameters[n].theta(here.values[n], null[n]) for n in names])
    covariance = here.covariance[np.ix_(rows, rows)]
    return float(chi2_sf(theta @ np.linalg.solve(covariance, theta), len(rows)))
