"""The refits that lead, each with what the second mesh adds at its own end.

What a mesh gets wrong depends on where crystals yield, and that on the cause. Of two causes that do
nearly the same, what the second mesh adds at the baseline favoured the wrong one by 5 units of log
evidence of 250; at their own ends they are as likely as each other.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from driver.common.outcomes import Failure, attempt
from driver.common.parallel import side_by_side
from driver.common.progress import quiet
from driver.diagnosis.answer.result_types import Refit
from driver.diagnosis.search.candidate_correction import REACH, leading_above
from driver.diagnosis.search.fine_models import FineModels, added_by_second
from driver.diagnosis.search.flip_trial import turned
from driver.diagnosis.search.refit import TOLERANCE, Executor, refit_of, with_prior
from driver.diagnosis.statistics.correction_change import changed_on_the_way
from driver.diagnosis.statistics.score_test import WORTH
from driver.forward.model import ForwardModel
from driver.identification.correction import SecondMesh
from driver.identification.fit import Fit, fit_from
from driver.identification.objective import Evaluation, Objective

logger = logging.getLogger(__name__)

_MOST = 3  # iterations
_PASSES = 4  # of one refit
_SETTLED = 2.0  # log evidence that another pass may change: less parts no causes


@dataclass(frozen=True, eq=False)
class _Task:
    """A refit, to be fitted again.

    Attributes:
        refit: the refit, with what the second mesh adds elsewhere.
        second: the model on the second mesh, its orientations those of the refit.
        size: of its cells, where they are the better ones [µm].
    """

    refit: Refit
    second: ForwardModel
    size: float | None


@dataclass(frozen=True, eq=False)
class _End:
    """What a process answers: its objective, with all images, stays where it is.

    Attributes:
        second: what the second mesh adds where the refit stood.
        fit: the fit with it.
    """

    second: SecondMesh
    fit: Fit


def with_second_mesh_at_ends(
    refits: Sequence[Refit], baseline: Evaluation, finer: FineModels, executor: Executor
) -> list[Refit]:
    """Refits, best evidence first, those that lead with what the second mesh adds at their own end.

    Where one leads alone, none is evidence, or one mesh has to do, nothing is simulated. Others
    follow the two best where as much as any of these has gained may bring them within reach of the
    best, and the one next to these. Each within reach goes on until its evidence settles. Where the
    end of one cannot be simulated all stay as they were, for no refit is to lead by a mesh that
    others lack; the log says so.

    Args:
        refits: the refits, best evidence first.
        baseline: the baseline at its optimum.
        finer: the finer models.
        executor: who refits.

    Raises:
        NotRunError: a simulation was not run.
        JobError, ResultFileError: one was killed, ran out of time or left no result.
    """
    if len(refits) < 2 or finer.make_second is None or refits[0].objective.second is None:
        return list(refits)
    best, next_best = (refit.log_evidence for refit in refits[:2])
    if best <= WORTH or next_best <= leading_above(best):
        return list(refits)
    logger.info("the second mesh at the end of the refits that lead")
    made = attempt(finer.make_second)
    if isinstance(made, Failure):
        logger.info(f"  it cannot be made ({made.why})")
        return list(refits)
    begun = {refit.cause.name: refit for refit in refits}
    own, to_come, passes = dict(begun), dict[str, float](), Counter[str]()
    again = list(refits[:2])
    while again:
        tasks = [_Task(refit, turned(made, (refit.cause,)), finer.size) for refit in again]
        ends = side_by_side(_fitted, tasks, executor.processes, executor.threads)
        for refit, end in zip(again, ends, strict=True):
            name = refit.cause.name
            if isinstance(end, Failure):
                logger.info(
                    f"  {name} cannot be simulated on it ({end.why}): all stay as they were"
                )
                return list(refits)
            fitted = refit_of(refit.cause, _under(end.second, refit), end.fit, baseline)
            own[name] = replace(fitted, corrected="at its end, on the second mesh")
            passes[name] += 1
            last = passes[name] == _PASSES
            to_come[name] = 0.0 if last else _to_come(refit, own[name], baseline)
        gains = [own[name].log_evidence - begun[name].log_evidence for name in to_come]
        again = _next(own.values(), to_come, gains)
    for name in to_come:
        before, after = (by[name].log_evidence for by in (begun, own))
        logger.info(f"  {name}: log evidence {before:+.1f} → {after:+.1f}")
    return sorted(own.values(), key=lambda refit: -refit.log_evidence)


def _next(
    refits: Iterable[Refit], to_come: Mapping[str, float], gains: Sequence[float]
) -> list[Refit]:
    """Return those to be fitted again: they may be the best, beside it, or next to these.

    Beside it are those within reach by evidence or by misfit, for either may hold a cause in its
    set. Of the others one is next: by how much the set leads is told, and both are to be what they
    are told to be.

    Args:
        refits: as far as they were fitted again.
        to_come: log evidence that another pass may change, by the name of the cause.
        gains: log evidence that those in it have gained. Others may gain as much as any of them,
            and gain their mean as a rule; what they lose they are not told to have lost.
    """
    largest, usual = max(0.0, *gains), max(0.0, float(np.mean(gains)))

    def gain(refit: Refit) -> float:
        return to_come.get(refit.cause.name, largest)

    first, *others = sorted(refits, key=lambda r: r.log_evidence + gain(r), reverse=True)
    evidence, misfit = first.log_evidence + gain(first), first.own_misfit - 2 * gain(first)
    near = [
        refit
        for refit in others
        if evidence - (refit.log_evidence + gain(refit)) < REACH
        or refit.own_misfit - 2 * gain(refit) - misfit < REACH
    ]
    behind = [refit for refit in others if refit not in near]
    behind.sort(key=lambda r: r.log_evidence + (0.0 if r.cause.name in to_come else usual))
    # No more is told of the one behind than its evidence, which need not settle.
    unseen = [refit for refit in behind[-1:] if refit.cause.name not in to_come]
    beside = [r for r in (first, *near) if to_come.get(r.cause.name, np.inf) >= _SETTLED]
    return [*beside, *unseen]


def _to_come(before: Refit, after: Refit, baseline: Evaluation) -> float:
    """Return log evidence that another pass may change.

    What a pass changes goes with the square of what was wrong before it. That is as much of what it
    was as the correction by the first mesh has changed on the way of the pass, over that on the way
    from the baseline; all of it for a correction without derivatives.
    """
    change = abs(after.log_evidence - before.log_evidence)
    stood, objective = before.fit, before.objective
    way = changed_on_the_way(objective, baseline.values, stood.best)
    if way == 0.0:
        return change
    return change * (changed_on_the_way(objective, stood.values, after.fit.best) / way) ** 2


@quiet()
def _fitted(task: _Task) -> _End | Failure:
    """Return a refit with what the second mesh adds where it stands, or why there is none."""
    refit, at = task.refit, task.refit.fit
    second = added_by_second(task.second, task.size, refit.objective, at)
    if isinstance(second, Failure):
        return second
    return _End(second, fit_from(at.best, _under(second, refit), _MOST, TOLERANCE))


def _under(second: SecondMesh, refit: Refit) -> Objective:
    """Return the objective of a refit with what the second mesh adds at its own end."""
    known = with_prior(refit.objective, refit.cause)
    whole = known.correction.without_second(known.second).with_second(second)
    return replace(known, correction=whole, second=second)
