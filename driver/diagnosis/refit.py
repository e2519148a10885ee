"""Nonlinear refits: a score is first order, and large effects need the whole model."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from driver.diagnosis.causes import Cause
from driver.diagnosis.score import Score
from driver.identification.fit import Evaluation, Fit, Objective, fit
from driver.side_by_side import side_by_side

MOST_ITERATIONS = 5
TOLERANCE = 0.3  # Newton decrement [σ]: a log evidence is then right to 0.05


@dataclass(frozen=True, eq=False)
class Refit:
    """A cause freed and everything fitted again.

    Attributes:
        cause: the cause.
        objective: the objective with the cause's prior, as wide as the effect was found large.
        fit: the fit, with a prior of one scale.
        log_evidence: natural log of the Bayes factor against the baseline (Laplace).
        levels: of a covariance cause its level and the standard deviation of it by name.
    """

    cause: Cause
    objective: Objective
    fit: Fit
    log_evidence: float
    levels: Mapping[str, tuple[float, float]] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class _Task:
    cause: Cause
    objective: Objective
    start: Evaluation
    baseline: Evaluation


def with_prior(objective: Objective, cause: Cause) -> Objective:
    """The objective with Gaussian priors of one prior scale about the null of a cause.

    The null of a constant of the law (of n, say) is its value in the case.
    """
    prior, nulls = dict(objective.prior), objective.model.null_values()
    for name in (*cause.parameters, *cause.companions):
        parameter = objective.parameters[name]
        prior[name] = (nulls[name], parameter.scale if parameter.logarithmic else 1.0)
    return replace(objective, prior=prior)


def as_wide_as_found(objective: Objective, cause: Cause, values: Mapping[str, float]) -> Objective:
    """The objective with the prior of a cause widened to the size of its effect.

    A prior of one scale decides whether there is an effect. It would then draw an effect of
    many scales towards zero, by the share that its variance has in that of the prior.
    """
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


def log_bayes_factor(
    baseline: Evaluation, extended: Evaluation, objective: Objective, added: Sequence[str]
) -> float:
    """Laplace evidence of an extended fit against its baseline, parameters marginalised."""
    before = float(np.linalg.slogdet(baseline.hessian)[1])
    after = float(np.linalg.slogdet(extended.hessian)[1])
    prior = -2.0 * sum(float(np.log(objective.prior[name][1])) for name in added)
    return 0.5 * (baseline.cost - extended.cost) + 0.5 * (before - after + prior)


def refit_causes(
    scores: Sequence[Score],
    screening: Evaluation,
    baseline: Evaluation,
    objective: Objective,
    processes: int,
    threads: int,
    log: Callable[[str], None],
) -> list[Refit]:
    """Refit causes side by side, each from the biased optimum of the baseline.

    Args:
        scores: the causes to refit.
        screening: evaluation at the baseline with the parameters of every cause free.
        baseline: the baseline at its optimum.
        objective: the objective of the baseline.
        processes: how many refits at a time.
        threads: threads of each.
        log: takes a line for each refit.
    """
    tasks = []
    for scored in scores:
        cause = scored.cause
        extended = with_prior(objective, cause)
        free = (*baseline.free, *cause.parameters, *cause.companions)
        tasks.append(_Task(cause, extended, extended.restrict(screening, free), baseline))

    def done(index: int, result: Refit) -> None:
        best = result.fit.best
        log(
            f"  {result.cause.name}: log evidence {result.log_evidence:+.1f}, "
            f"χ_F {best.chi_load:.2f}, χ of images {best.chi_image:.3f} ({result.fit.reason})"
        )

    return side_by_side(_refit, tasks, processes, threads, done)


def _refit(task: _Task) -> Refit:
    result = fit(
        task.objective, task.start.values, task.start.free, MOST_ITERATIONS, _silent,
        start=task.start, tolerance=TOLERANCE,
    )  # fmt: skip
    added = (*task.cause.parameters, *task.cause.companions)
    evidence = log_bayes_factor(task.baseline, result.best, task.objective, added)
    widened = as_wide_as_found(task.objective, task.cause, result.values)
    return Refit(task.cause, widened, result, evidence)


def _silent(line: str) -> None:
    """Refits run side by side: their iterations would interleave."""
