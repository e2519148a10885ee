"""Nonlinear refits: a score is first order, and large effects need the whole model."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from driver.common.outcomes import Failure, attempt
from driver.common.parallel import side_by_side
from driver.common.progress import quiet
from driver.diagnosis.answer.result_types import Refit
from driver.diagnosis.causes.causes import Cause
from driver.diagnosis.statistics.bayes_factor import log_bayes_factor
from driver.diagnosis.statistics.score_test import Score
from driver.identification.fit import Fit, fit
from driver.identification.line_search import promised
from driver.identification.objective import Evaluation, Objective
from driver.identification.priors import FREED_WIDTH

logger = logging.getLogger(__name__)

MOST_ITERATIONS = 5
MOST_FROM_AFAR = 8
FAR = (1.0, 3.0)  # prior scales
HOPEFUL = 0.5  # of what the best gains, that a rival has to promise or to gain on its way
TOLERANCE = 0.3  # Newton decrement [σ]: a log evidence is then right to 0.05


@dataclass(frozen=True)
class Executor:
    """Who refits.

    Attributes:
        processes: how many fits at a time.
        threads: threads of each.
    """

    processes: int
    threads: int


@dataclass(frozen=True, eq=False)
class Start:
    """Where the refit of a cause begins.

    Attributes:
        cause: the cause.
        objective: the objective with the prior of the cause.
        values: every parameter.
        start: evaluation there, None where it is not known yet.
        baseline: the baseline at its optimum.
        threshold: cost which each step has to promise.
        most: largest number of iterations.
    """

    cause: Cause
    objective: Objective
    values: dict[str, float]
    start: Evaluation | None
    baseline: Evaluation
    threshold: float
    most: int


def with_prior(objective: Objective, cause: Cause) -> Objective:
    """Return objective with the Gaussian priors under which a cause is refitted, about its null.

    The null of a constant of the law (of n, say) is its value in the case. A companion that has a
    prior already, for it is fitted without the cause, keeps it.
    """
    prior, nulls = dict(objective.prior), objective.model.null_values()
    for name in cause.parameters:
        prior[name] = (nulls[name], FREED_WIDTH * objective.parameters[name].width)
    for name in cause.companions:
        prior.setdefault(name, (nulls[name], objective.parameters[name].width))
    return replace(objective, prior=prior)


def as_wide_as_found(objective: Objective, cause: Cause, values: Mapping[str, float]) -> Objective:
    """Return the objective with the prior of a cause widened to the size of its effect.

    That of a refit would draw an effect of many scales towards zero, by the share that its
    variance has in that of the prior.
    """
    if not cause.parameters:
        return objective
    sizes = [
        objective.parameters[name].theta(values[name], objective.prior[name][0])
        / objective.prior[name][1]
        for name in cause.parameters
    ]
    factor = max(1.0, float(np.sqrt(np.mean(np.square(sizes)))))
    prior = dict(objective.prior)
    for name in cause.parameters:
        null, width = prior[name]
        prior[name] = (null, factor * width)
    return replace(objective, prior=prior)


def refit_causes(
    scores: Sequence[Score],
    screening: Evaluation,
    baseline: Evaluation,
    objective: Objective,
    executor: Executor,
    threshold: float = np.inf,
) -> list[Refit]:
    """Refit causes side by side, each from the biased optimum of the baseline.

    Args:
        scores: the causes to refit.
        screening: evaluation at the baseline with the parameters of every cause free.
        baseline: the baseline at its optimum.
        objective: the objective of the baseline.
        executor: who refits.
        threshold: cost which each step has to promise; a cause of which one does not is left out.

    Raises:
        NotRunError: a simulation was not run.
        JobError, ResultFileError: one was killed, ran out of time or left no result.
    """
    tasks, hopeless = [], []
    for scored in scores:
        extended = with_prior(objective, scored.cause)
        begin = extended.restrict(screening, freed_with(baseline, scored.cause))
        if np.isfinite(threshold) and promised(extended, begin) > threshold:
            hopeless.append(scored.cause.name)
            continue
        start = Start(
            scored.cause, extended, begin.values, begin, baseline, threshold, MOST_ITERATIONS
        )
        tasks.append(start)
    if hopeless:
        logger.info(f"  the first step promises too little of {', '.join(hopeless)}")
    return refit_from(tasks, executor)


def refit_from_afar(
    scores: Sequence[Score],
    baseline: Evaluation,
    objective: Objective,
    executor: Executor,
    threshold: float,
) -> list[Refit]:
    """Refit causes from the nominal model with ±1 and ±3 prior scales of each.

    The biased optimum bends the fitted parameters to make up for a large effect, and a fit from
    there may stall. Nominal are the means of the priors; knots, which have none, stay.

    Args:
        scores: the causes to refit.
        baseline: the baseline at its optimum.
        objective: the objective of the baseline.
        executor: who refits.
        threshold: cost which each step has to promise; a start of which one does not is given up.

    Raises:
        NotRunError: a simulation was not run.
        JobError, ResultFileError: one was killed, ran out of time or left no result.
    """
    tasks = []
    for scored in scores:
        extended, cause = with_prior(objective, scored.cause), scored.cause
        for values in nominal_starts(scored, baseline, extended):
            tasks.append(Start(cause, extended, values, None, baseline, threshold, MOST_FROM_AFAR))
    return refit_from(tasks, executor)


def nominal_starts(
    scored: Score, baseline: Evaluation, extended: Objective
) -> list[dict[str, float]]:
    """Return the nominal model with the cause ±1 and ±3 prior scales off its null.

    Several parameters go together, in the proportions of the estimate to first order.

    Args:
        scored: the cause.
        baseline: the baseline at its optimum.
        extended: the objective with the priors of the cause.
    """
    cause, prior, known = scored.cause, extended.prior, extended.parameters
    values = nominal(baseline, extended)
    values |= {name: prior[name][0] for name in cause.companions}
    largest = float(np.max(np.abs(scored.estimate)))
    along = scored.estimate / largest if largest > 0 else np.ones(len(cause.parameters))
    sides = (1.0,) if cause.one_sided else (1.0, -1.0)
    along = np.abs(along) if cause.one_sided else along
    return [
        values
        | {
            name: known[name].value(float(side * far * part * known[name].width), prior[name][0])
            for name, part in zip(cause.parameters, along, strict=True)
        }
        for far in FAR
        for side in sides
    ]


def nominal(baseline: Evaluation, objective: Objective) -> dict[str, float]:
    """Every parameter at the mean of its prior; those without one, as the knots, stay."""
    prior = objective.prior
    return baseline.values | {name: prior[name][0] for name in baseline.free if name in prior}


def added_by(cause: Cause, baseline: Evaluation) -> tuple[str, ...]:
    """Return what a cause frees; a companion may be free already, with another cause."""
    named = (*cause.parameters, *cause.companions)
    return tuple(name for name in named if name not in baseline.free)


def freed_with(baseline: Evaluation, cause: Cause) -> tuple[str, ...]:
    """Return what is free where a cause is."""
    return (*baseline.free, *added_by(cause, baseline))


def refit_from(tasks: Sequence[Start], executor: Executor) -> list[Refit]:
    """Refits side by side; starts that are given up are told and left out.

    Raises:
        NotRunError: a simulation was not run.
        JobError, ResultFileError: one was killed, ran out of time or left no result.
    """
    refits: dict[int, Refit] = {}
    # Those that bend take the most iterations: were one the last, it would run alone.
    order = sorted(range(len(tasks)), key=lambda k: not tasks[k].cause.strongly_nonlinear)

    def done(place: int, result: Fit | str) -> None:
        index = order[place]
        task = tasks[index]
        if isinstance(result, str):
            logger.info(f"  {task.cause.name}: a start is given up, {result}")
            return
        # Objectives of this process share the images; one of another process brings its own.
        refits[index] = refit_of(task.cause, task.objective, result, task.baseline)
        logger.info(refit_line(refits[index]))

    in_order = [tasks[index] for index in order]
    side_by_side(_fitted, in_order, executor.processes, executor.threads, done)
    return [refits[index] for index in sorted(refits)]


def refit_line(refit: Refit) -> str:
    """Return a refit as a line of the log."""
    best = refit.fit.best
    return (
        f"  {refit.cause.name}: log evidence {refit.log_evidence:+.1f}, "
        f"χ_F {best.chi_load:.2f}, χ of images {best.chi_image:.3f} ({refit.fit.reason})"
    )


@quiet()
def _fitted(task: Start) -> Fit | str:
    """Return the fit, or why the start was given up."""
    objective, begin = task.objective, task.start
    if begin is None:
        beside, free = (
            objective.warm_started_from(task.baseline),
            freed_with(task.baseline, task.cause),
        )
        first = attempt(lambda: beside.evaluate(task.values, free))
        if isinstance(first, Failure):
            return f"for it cannot be simulated ({first.why})"
        begin = first
    result = fit(
        objective,
        begin.values,
        begin.free,
        task.most,
        begin,
        TOLERANCE,
        threshold=task.threshold,
    )
    if result.given_up:
        return f"for {result.reason}"
    return result


def refit_of(cause: Cause, objective: Objective, result: Fit, baseline: Evaluation) -> Refit:
    """Return the refit that a fit with the prior of a cause is.

    Args:
        cause: the cause.
        objective: the objective of the fit, with the prior of the cause.
        result: the fit.
        baseline: the baseline at its optimum.
    """
    companions = [name for name in added_by(cause, baseline) if name in cause.companions]
    effects, rising = [cause.parameters], cause.parameters if cause.one_sided else ()
    evidence = log_bayes_factor(baseline, result.best, objective, effects, companions, rising)
    evidence += float(np.log(cause.odds))
    return Refit(cause, as_wide_as_found(objective, cause, result.values), result, evidence)
