"""Refits of large effects, begun where the loads count for little.

Loads that a model cannot meet bend its fit: it gives up images, apex amplitudes and knots to come
a little nearer to them. From such a baseline no derivative holds, and the refit of the true cause
creeps along a narrow valley as that of any other does. With loads as noisy as they are far off the
images hold the fit near what happened: the effect shows there by its first step, and the refit
stays on its way while the loads become as precise as they are (a continuation in their noise).
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from driver.common.outcomes import Failure, attempt
from driver.common.parallel import side_by_side
from driver.common.progress import quiet
from driver.diagnosis.answer.result_types import Refit
from driver.diagnosis.search.refit import (
    HOPEFUL,
    MOST_FROM_AFAR,
    MOST_ITERATIONS,
    TOLERANCE,
    Executor,
    freed_with,
    nominal,
    refit_line,
    refit_of,
    with_prior,
)
from driver.diagnosis.statistics.score_test import Score
from driver.identification.fit import POLISH, Fit, fit, fit_from
from driver.identification.line_search import promised
from driver.identification.objective import Evaluation, Objective

logger = logging.getLogger(__name__)

SOFTER = 30.0  # times as soft loads hardly count
ON_THE_WAY = 1.0  # Newton decrement of a fit that only begins the next one [σ]


def softened(objective: Objective, factor: float) -> Objective:
    """Return the objective with loads that are so many times as noisy."""
    return replace(
        objective, data=replace(objective.data, load_noise=factor * objective.data.load_noise)
    )


def refit_by_noise_continuation(
    tried: Sequence[Score],
    names: Sequence[str],
    baseline: Evaluation,
    objective: Objective,
    most: int,
    executor: Executor,
) -> list[Refit]:
    """Refits of the causes that show below soft loads, by the way that these leave free.

    Args:
        tried: the causes.
        names: what is free where each of them is.
        baseline: the baseline at its optimum.
        objective: its objective.
        most: how many causes are refitted below soft loads, close rivals of the best aside.
        executor: who refits.

    Raises:
        SolverError: a simulation could not be finished.
    """
    softness = baseline.chi_load
    soft = softened(objective, softness)
    logger.info(f"loads of {softness:.3g} times their noise, as far as the model is off")
    begin = _by_the_images(softened(objective, SOFTER * softness), baseline)
    softened_fit = fit_from(begin.best, soft, POLISH, TOLERANCE)
    augmented = soft.with_free(softened_fit.best, names)
    tasks = [_task(scored, objective, soft, augmented, baseline) for scored in tried]
    promises = [softened_fit.best.cost - promised(task.soft, task.start) for task in tasks]
    order = np.argsort(promises)[::-1]
    threshold = HOPEFUL * max(promises)
    chosen = [tasks[k] for n, k in enumerate(order) if n < most or promises[k] > threshold]
    logger.info(f"refitting {', '.join(task.score.cause.name for task in chosen)}")
    ends = side_by_side(_below_soft_loads, chosen, executor.processes, executor.threads)
    gained = [softened_fit.best.cost - end.best.cost for end in ends]
    for task, gain in zip(chosen, gained, strict=True):
        logger.info(f"  {task.score.cause.name}: gains {gain:.0f} σ² there")
    hopeful = [
        replace(task, start=end.best)
        for task, end, gain in zip(chosen, ends, gained, strict=True)
        if gain >= HOPEFUL * max(gained)
    ]

    refits: dict[int, Refit] = {}

    def done(index: int, result: Fit) -> None:
        task = hopeful[index]
        refits[index] = refit_of(task.score.cause, task.hard, result, task.baseline)
        logger.info(refit_line(refits[index]))

    side_by_side(_as_precise_as_they_are, hopeful, executor.processes, executor.threads, done)
    return [refits[index] for index in sorted(refits)]


def _by_the_images(objective: Objective, baseline: Evaluation) -> Fit:
    """Fit where the images lead, from the nominal model: the baseline itself is bent."""
    values, free = nominal(baseline, objective), baseline.free
    result = attempt(lambda: fit(objective, values, free, POLISH, tolerance=ON_THE_WAY))
    if isinstance(result, Failure):
        logger.info(f"  not from the nominal model ({result.why})")
        return fit_from(baseline, objective, POLISH, ON_THE_WAY)
    return result


@dataclass(frozen=True, eq=False)
class _Task:
    """A cause to refit.

    Attributes:
        score: of it.
        hard, soft: the objectives with its prior, with the loads as they are and below soft ones.
        start: where its refit begins, under `soft`.
        baseline: the baseline at its optimum.
    """

    score: Score
    hard: Objective
    soft: Objective
    start: Evaluation
    baseline: Evaluation


def _task(
    one: Score, objective: Objective, soft: Objective, augmented: Evaluation, baseline: Evaluation
) -> _Task:
    extended = with_prior(soft, one.cause)
    start = extended.restrict(augmented, freed_with(baseline, one.cause))
    return _Task(one, with_prior(objective, one.cause), extended, start, baseline)


@quiet()
def _below_soft_loads(task: _Task) -> Fit:
    at = task.start
    return fit(task.soft, at.values, at.free, MOST_ITERATIONS, at, ON_THE_WAY)


@quiet()
def _as_precise_as_they_are(task: _Task) -> Fit:
    """Return the fit, by way of loads half as soft on a logarithmic scale."""
    at = task.start
    half = softened(task.hard, np.sqrt(task.baseline.chi_load))
    for objective, most, tolerance in (
        (half, MOST_ITERATIONS, ON_THE_WAY),
        (task.hard, MOST_FROM_AFAR, TOLERANCE),
    ):
        result = fit_from(at, objective, most, tolerance)
        at = result.best
    return result
