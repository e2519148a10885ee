"""Looks under the correction where a cause stands, and refits that begin there.

The derivatives of the correction at the fit hold near the fit. Of a contrast of four prior scales
they made a wrong valley: the fit ended at an eighth of it, from wherever it began. So what promises
something is seen again under the correction taken there. What bends is refitted under the
correction that goes straight from that at the fit to that of the look, then under that at its end.
What ends elsewhere, or lies somewhere, is refitted under the correction where it begins, then under
those at its ends. Those that lead are corrected on.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from driver.common.outcomes import Failure, attempt
from driver.common.parallel import side_by_side
from driver.diagnosis.answer.result_types import Refit
from driver.diagnosis.causes.causes import Cause
from driver.diagnosis.search.candidate_correction import (
    SETTLED,
    corrected_refit,
    left_elsewhere,
    under,
)
from driver.diagnosis.search.looks import Side, Task, seen_at
from driver.diagnosis.search.refit import (
    MOST_FROM_AFAR,
    Executor,
    Start,
    freed_with,
    refit_from,
    refit_line,
    refit_of,
)
from driver.diagnosis.statistics.bayes_factor import amounts_of
from driver.identification.correction import Correction, correction
from driver.identification.fit import Fit
from driver.identification.objective import Evaluation, Objective

logger = logging.getLogger(__name__)

_FARTHEST = 7.0
"""Prior scales with which the refit of a band begins at most: of τ₀ a factor of two."""
_MOST_CORRECTIONS = 4
_OF_WHAT_BENDS = 2
"""Corrections of a refit of what bends: it leads or not, and those that lead are corrected on."""


def seen_corrected(
    task: Task, extended: Objective, sides: Sequence[Side], which: Sequence[int], told_by: str
) -> list[Side]:
    """Return looks at a cause, some of them under the correction taken there.

    One that cannot be simulated on the finer mesh stays as it was seen.

    Args:
        task: the cause.
        extended: the objective with its prior.
        sides: what was seen of it.
        which: those that are seen again, by their place in the sequence.
        told_by: the parameter by which they are told apart.

    Raises:
        NotRunError: a simulation was not run.
        JobError, ResultFileError: one was killed, ran out of time or left no result.
    """
    model, known = extended.warm_started_from(task.here.best).model, extended.correction

    def corrected(at: Evaluation) -> Correction | Failure:
        left = left_elsewhere(known.left_by_steps, task.here.best, at)
        return attempt(
            lambda: correction(
                model, task.finer, at.prediction, at.values, near=known, left_by_steps=left
            )
        )

    seen = list(sides)
    changes = side_by_side(corrected, [sides[place].at for place in which], 1)
    for place, change in zip(which, changes, strict=True):
        side = sides[place]
        if isinstance(change, Failure):
            told = f"{told_by} = {side.at.values[told_by]:.3g} cannot be simulated finer"
            logger.info(f"  {told} ({change.why})")
            continue
        there = under(change, extended)
        at = there.compare(side.at.prediction, side.at.values, ())
        seen[place] = replace(seen_at(task, at, side.amount), correction=there.correction)
    return seen


def refit_from_look(task: Task, extended: Objective, begin: Side) -> Refit | None:
    """Return the refit of a cause from where it was looked at; None if it is given up.

    Args:
        task: the cause.
        extended: the objective with its prior.
        begin: where it begins.

    Raises:
        NotRunError: a simulation was not run.
        JobError, ResultFileError: one was killed, ran out of time or left no result.
    """
    if task.near.cause.places:
        values = _begun(begin, extended, _FARTHEST)
        return _from_its_start(task, extended, values, _MOST_CORRECTIONS)
    # What bends was seen no farther.
    values = _begun(begin, extended, abs(begin.amount))
    between = _between_null_and_look(task, extended, begin, values)
    return between or _from_its_start(task, extended, values, _OF_WHAT_BENDS)


def _between_null_and_look(
    task: Task, extended: Objective, begin: Side, values: dict[str, float]
) -> Refit | None:
    """Return the refit under the correction that is known at the null of a cause and at the look.

    The derivative of that at the null holds near it alone. The refit goes on under the correction
    at its end. None where it does not end between both, or there is no correction of the look.
    """
    if begin.correction is None:
        return None
    cause, fitted = task.near.cause, task.here.best
    (name,) = cause.parameters
    null, parameter = extended.prior[name][0], extended.parameters[name]
    straight = extended.correction.through(begin.correction, begin.at.values, null, parameter)
    under_it = replace(extended, correction=straight)
    start = Start(cause, under_it, values, None, fitted, np.inf, MOST_FROM_AFAR)
    refit = next(iter(refit_from([start], Executor(1, 1))), None)
    if refit is None:
        return None
    (amount,) = amounts_of(cause.parameters, refit.fit.values, extended)
    if not 0.0 <= amount / begin.amount <= 1.0:
        return None
    left = extended.correction.left_by_steps
    after = corrected_refit(refit, task.finer, fitted, MOST_FROM_AFAR, left)
    if isinstance(after, Failure):
        logger.info(_no_further(cause, after))
        return replace(refit, corrected="at a look")
    logger.info(refit_line(after))
    return after


def _no_further(cause: Cause, failed: Failure) -> str:
    return f"  {cause.name}: no further correction, for that failed ({failed.why})"


def _from_its_start(
    task: Task, extended: Objective, values: dict[str, float], most: int
) -> Refit | None:
    """Return the refit under corrections of its own.

    The first is that where it begins, the next are those at its ends until the evidence settles, or
    as far as these can be simulated.

    Args:
        task: the cause.
        extended: the objective with its prior.
        values: every parameter where it begins.
        most: largest number of corrections.
    """
    cause, fitted = task.near.cause, task.here.best
    free, beside = freed_with(fitted, cause), extended.warm_started_from(fitted)
    first = attempt(lambda: beside.evaluate(values, free))
    if isinstance(first, Failure):
        logger.info(f"  {cause.name}: given up, for it cannot be simulated ({first.why})")
        return None
    here = refit_of(cause, extended, Fit(first, False, "where it was looked at", ()), fitted)
    left = extended.correction.left_by_steps
    done: Refit | None = None
    for _ in range(most):
        after = corrected_refit(here, task.finer, fitted, MOST_FROM_AFAR, left)
        if isinstance(after, Failure):
            logger.info(_no_further(cause, after))
            break
        settled = done is not None and abs(after.log_evidence - here.log_evidence) < SETTLED
        # The first correction is that where the refit begins.
        here = done = after if done is not None else replace(after, corrected="at a look")
        if settled:
            break
    if done is not None:
        logger.info(refit_line(done))
    return done


def _begun(begin: Side, extended: Objective, most: float) -> dict[str, float]:
    """Return every parameter where a refit begins.

    The cause has the size that the change bears.

    Args:
        begin: the look.
        extended: the objective with the prior of the cause.
        most: largest size, in prior scales.
    """
    (name,) = begin.score.cause.parameters
    size = np.clip(begin.score.estimate[0], -most, most) * extended.parameters[name].width
    begun = extended.parameters[name].value(float(size), extended.prior[name][0])
    return begin.at.values | {name: begun}
