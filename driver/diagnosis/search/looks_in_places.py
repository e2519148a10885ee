"""Looks at a cause that lies somewhere, as a band across a grain, and its refit there.

Its derivative is that of one place, and so is what that says of the correction. It is looked at in
several, in the two that promise most under the correction taken there. The refit from one of them
is made again under the correction at its end until that settles. Place and width are found by the
data as well.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from driver.common.outcomes import Failure, attempt
from driver.common.parallel import side_by_side
from driver.diagnosis.answer.result_types import Refit
from driver.diagnosis.search.candidate_correction import corrected_refit, under
from driver.diagnosis.search.looks import Side, Task, promises, seen_at
from driver.diagnosis.search.refit import FAR, MOST_FROM_AFAR, freed_with, refit_line, refit_of
from driver.diagnosis.statistics.bayes_factor import amounts_of
from driver.forward.prediction import Prediction
from driver.identification.correction import Correction, correction
from driver.identification.fit import Fit
from driver.identification.objective import Evaluation, Objective

logger = logging.getLogger(__name__)

_FARTHEST = 7.0
"""Prior scales with which a refit begins at most: of τ₀ a factor of two."""
SEEN_FINER = 2
"""Places that are seen under the correction there, at most."""
_MOST_CORRECTIONS = 4
_SETTLED = 1.0  # change of the log evidence by the last of them


def looks_in_places(task: Task, extended: Objective) -> list[Side]:
    """Return the fit with a cause off its null in each of its places, or where the case states it.

    The two places that promise most are seen again under the correction there: that of the fit
    knows no band, and its derivative is that of one place.

    Args:
        task: the cause.
        extended: the objective with its prior.
    """
    cause, fitted = task.near.cause, task.here
    (name,), where = cause.parameters, cause.companions[0]
    null, parameter = extended.prior[name][0], extended.parameters[name]
    model = extended.warm_started_from(fitted.best).model
    off = parameter.value(-FAR[-1] * parameter.width, null)
    places = cause.places if null == 0.0 else (fitted.values[where],)
    every = [fitted.values | {name: off, where: place} for place in places]

    def predicted(values: Mapping[str, float]) -> Prediction | Failure:
        return attempt(lambda: model.predict(values, ()))

    def corrected(at: Evaluation) -> Correction | Failure:
        return attempt(
            lambda: correction(
                model, task.finer, at.prediction, at.values, near=extended.correction
            )
        )

    sides = []
    for values, prediction in zip(every, side_by_side(predicted, every, 1), strict=True):
        if isinstance(prediction, Failure):
            logger.info(f"  {where} = {values[where]:.3g} cannot be simulated ({prediction.why})")
            continue
        at = extended.compare(prediction, values, ())
        sides.append(seen_at(task, at, float(amounts_of(cause.parameters, values, extended)[0])))
    promising = [place for place, side in enumerate(sides) if promises(side)]
    again = sorted(promising, key=lambda place: -sides[place].score.statistic)[:SEEN_FINER]
    changes = side_by_side(corrected, [sides[place].at for place in again], 1)
    for place, change in zip(again, changes, strict=True):
        side = sides[place]
        if isinstance(change, Failure):
            told = f"{where} = {side.at.values[where]:.3g} cannot be simulated finer"
            logger.info(f"  {told} ({change.why})")
            continue
        at = under(change, extended).compare(side.at.prediction, side.at.values, ())
        sides[place] = replace(seen_at(task, at, side.amount), is_corrected=True)
    return sides


def refit_from_place(task: Task, extended: Objective, begin: Side) -> list[Refit]:
    """Return the refit of a cause from a place; none if it is given up.

    It is made under the correction where it begins, then under those at its ends until the evidence
    settles, or as far as these can be simulated.

    Args:
        task: the cause.
        extended: the objective with its prior.
        begin: where it begins.
    """
    cause, fitted = task.near.cause, task.here.best
    # Of either sign, and of the size that the change bears.
    (name,) = cause.parameters
    size = np.clip(begin.score.estimate[0], -_FARTHEST, _FARTHEST) * extended.parameters[name].width
    values = begin.at.values | {
        name: extended.parameters[name].value(float(size), extended.prior[name][0])
    }
    free, beside = freed_with(fitted, cause), extended.warm_started_from(fitted)
    first = attempt(lambda: beside.evaluate(values, free))
    if isinstance(first, Failure):
        logger.info(f"  {cause.name}: given up, for it cannot be simulated ({first.why})")
        return []
    here = refit_of(cause, extended, Fit(first, False, "where it was looked at", ()), fitted)
    done: list[Refit] = []
    for _ in range(_MOST_CORRECTIONS):
        after = corrected_refit(here, task.finer, fitted, MOST_FROM_AFAR)
        if isinstance(after, Failure):
            logger.info(f"  {cause.name}: no further correction, for that failed ({after.why})")
            break
        settled = bool(done) and abs(after.log_evidence - here.log_evidence) < _SETTLED
        here, done = after, [after]
        if settled:
            break
    for refit in done:
        logger.info(refit_line(refit))
    return done
