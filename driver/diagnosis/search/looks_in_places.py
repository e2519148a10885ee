"""Looks at a cause that lies somewhere, as a band across a grain.

Its derivative is that of one place, and so is what that says of the correction. It is looked at in
several, softer and harder than its rest, and where it promises most under the correction taken
there. Place and width are found by its refit as well.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping

from driver.common.outcomes import Failure, attempt
from driver.common.parallel import side_by_side
from driver.diagnosis.search.corrected_looks import seen_corrected
from driver.diagnosis.search.looks import Side, Task, on_its_side, promises, seen_at
from driver.diagnosis.search.refit import FAR
from driver.diagnosis.statistics.bayes_factor import amounts_of
from driver.forward.prediction import Prediction
from driver.identification.objective import Objective

logger = logging.getLogger(__name__)

SEEN_FINER = 2
"""Looks that are seen under the correction there, at most."""
SIDES = (-1.0, 1.0)
"""Softer and harder: far off, the effect of one is not that of the other with its sign changed."""


def looks_in_places(task: Task, extended: Objective) -> list[Side]:
    """Return the fit with a cause on both sides of its null in each of its places.

    One that the case states is looked at where it is stated. The two looks that promise most are
    seen again under the correction there: that of the fit knows no band, and its derivative is
    that of one place.

    Args:
        task: the cause.
        extended: the objective with its prior.

    Raises:
        NotRunError: a simulation was not run.
        JobError, ResultFileError: one was killed, ran out of time or left no result.
    """
    cause, fitted = task.near.cause, task.here
    (name,), where = cause.parameters, cause.companions[0]
    null, parameter = extended.prior[name][0], extended.parameters[name]
    model = extended.warm_started_from(fitted.best).model
    heights = [parameter.value(side * FAR[-1] * parameter.width, null) for side in SIDES]
    places = cause.places if null == 0.0 else (fitted.values[where],)
    every = [fitted.values | {name: height, where: place} for place in places for height in heights]

    def predicted(values: Mapping[str, float]) -> Prediction | Failure:
        return attempt(lambda: model.predict(values, ()))

    sides = []
    for values, prediction in zip(every, side_by_side(predicted, every, 1), strict=True):
        if isinstance(prediction, Failure):
            told = f"{name} = {values[name]:.3g} at {where} = {values[where]:.3g}"
            logger.info(f"  {told} cannot be simulated ({prediction.why})")
            continue
        at = extended.compare(prediction, values, ())
        sides.append(seen_at(task, at, float(amounts_of(cause.parameters, values, extended)[0])))
    promising = [which for which, s in enumerate(sides) if on_its_side(s) and promises(s)]
    again = sorted(promising, key=lambda which: -sides[which].score.statistic)[:SEEN_FINER]
    return seen_corrected(task, extended, sides, again, where)
