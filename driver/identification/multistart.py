"""Several starts of an identification: the best is kept, and how far the others end is told."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Generic, TypeVar

import numpy as np

from driver.common.outcomes import Failure, attempt
from driver.common.parallel import side_by_side
from driver.identification.fit import Fit
from solver_adapters.parameter import Parameter

logger = logging.getLogger(__name__)

SEED = 20160501  # of the starts that are drawn
FARTHEST = 2.0  # widths from the start of the case
SAME = 1.0  # difference of the cost within which two starts have found the same

Task = TypeVar("Task")
Result = TypeVar("Result")


@dataclass(frozen=True)
class Outcome:
    """Where a start led.

    Attributes:
        cost: cost of the fit at its end, infinite where it failed.
        values: the parameters of the law at its end.
        reason: why it ended.
    """

    cost: float
    values: Mapping[str, float]
    reason: str


def draw_starts(
    start: Mapping[str, float],
    parameters: Mapping[str, Parameter],
    spread: Mapping[str, float],
    number: int,
) -> list[dict[str, float]]:
    """Return the start of the case, and others drawn about it, the same ones in each run.

    Args:
        start: every parameter at the start of the case.
        parameters: declarations by name.
        spread: standard deviation in θ of the parameters that are drawn.
        number: of starts, the first included.
    """
    rng = np.random.default_rng(SEED)
    starts = [dict(start)]
    for _ in range(number - 1):
        drawn = np.clip(rng.standard_normal(len(spread)), -FARTHEST, FARTHEST)
        starts.append(
            dict(start)
            | {
                name: parameters[name].value(float(z * width), start[name])
                for z, (name, width) in zip(drawn, spread.items(), strict=True)
            }
        )
    return starts


def from_each_start(
    work: Callable[[Task], Result],
    tasks: Sequence[Task],
    fit_of: Callable[[Result], Fit],
    told: Sequence[str],
    processes: int,
    threads: int,
) -> tuple[Result, tuple[Outcome, ...]]:
    """Work from each start side by side, and keep the result of the least cost.

    Args:
        work: a function of a module.
        tasks: one for each start, that of the case first.
        fit_of: the fit in a result.
        told: names of the parameters of which the spread is told.
        processes: how many starts at a time.
        threads: threads of each.

    Returns:
        The best result, and what became of each start.

    Raises:
        SolverError: the start of the case cannot be simulated; of others this is told only.
    """
    logger.info(f"{len(tasks)} starts, those after the first drawn with seed {SEED}")

    def outcome(result: Result | Failure) -> Outcome:
        if isinstance(result, Failure):
            return Outcome(float("inf"), {}, result.why)
        end = fit_of(result)
        return Outcome(end.best.cost, {name: end.values[name] for name in told}, end.reason)

    def done(index: int, result: Result | Failure) -> None:
        ended = outcome(result)
        listed = ", ".join(f"{name} {value:.4g}" for name, value in ended.values.items())
        logger.info(
            f"  start {index + 1}: cost {ended.cost:.1f}, {listed or 'failed'} ({ended.reason})"
        )

    jobs = [_Job[Task, Result](work, task, index == 0) for index, task in enumerate(tasks)]
    results = side_by_side(_from_start, jobs, processes, threads, done)
    outcomes = tuple(outcome(result) for result in results)
    costs = [ended.cost for ended in outcomes]
    best = int(np.argmin(costs))
    near = sum(cost - costs[best] < SAME for cost in costs)
    logger.info(f"  kept start {best + 1}; {near} of {len(tasks)} end within {SAME:g} of its cost")
    kept = results[best]
    assert not isinstance(kept, Failure)
    return kept, outcomes


@dataclass(frozen=True, eq=False)
class _Job(Generic[Task, Result]):
    work: Callable[[Task], Result]
    task: Task
    must: bool


def _from_start(job: _Job[Task, Result]) -> Result | Failure:
    work = partial(job.work, job.task)
    return work() if job.must else attempt(work)
