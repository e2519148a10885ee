"""The refits that lead, each under the correction at its own end.

What the working mesh gets wrong depends on where crystals yield, and that on the cause: of causes
that do much the same the correction at the baseline may favour the wrong one by several units of
log evidence. Its derivatives tell the most of that, but not far from there: it is taken again until
the evidence settles.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from driver.common.outcomes import Failure, attempt
from driver.common.parallel import side_by_side
from driver.common.progress import quiet
from driver.diagnosis.answer.result_types import Refit
from driver.diagnosis.search.fine_models import FineModels
from driver.diagnosis.search.refit import TOLERANCE, Executor, refit_of, with_prior
from driver.diagnosis.statistics.correction_change import changed_on_the_way
from driver.forward.model import ForwardModel
from driver.identification.correction import Correction, correction
from driver.identification.fit import Fit, fit_from
from driver.identification.objective import Evaluation, Objective
from driver.identification.step_error import StepError

logger = logging.getLogger(__name__)

REACH = 10.0
"""Log evidence below the best within which a correction may change the order."""
REACH_OF_LARGE = 0.15
"""The same as a share of a large one: what derivatives do not hold grows with the effect."""
_MOST = 3  # iterations
_AT_FIRST = 2  # refits that are corrected before any is judged
_CORRECTIONS = 5  # of one refit
SETTLED = 1.0  # change of the log evidence by the last of them
_TO_COME = 2.0
"""Gains still to come over the last one: those of a turn of 5° on coarse cells, 39, 45, 22, 11 and
3 one after the other, were 2.1, 0.8 and 0.6 times as large."""


@dataclass(frozen=True, eq=False)
class _Task:
    """A refit, to be fitted again.

    Attributes:
        refit: the refit, under the correction that it has.
        finer: the finer model, its orientations those of the refit.
        most: largest number of iterations.
        left: what time steps leave wrong there, None where it is to be simulated.
    """

    refit: Refit
    finer: ForwardModel
    most: int = _MOST
    left: StepError | None = None


@dataclass(frozen=True, eq=False)
class _End:
    """What a process answers: its objective, with all images, stays where it is.

    Attributes:
        change: finer minus working prediction where the refit stood.
        fit: the fit with it.
    """

    change: Correction
    fit: Fit


def with_candidate_corrections(
    refits: Sequence[Refit], baseline: Evaluation, finer: FineModels, executor: Executor
) -> list[Refit]:
    """Refits, best evidence first, those that lead under the correction at their own end.

    Where one leads alone, with whatever a correction may bring the others (`_may_gain`), nothing is
    simulated. The two best are corrected first, others where what that changes may bring
    them to the front, or where they are next to it. One whose end the finer model cannot simulate
    stays as it was, and the log says so.

    Args:
        refits: the refits, best evidence first.
        baseline: the baseline at its optimum.
        finer: the finer models.
        executor: who refits.

    Raises:
        NotRunError: a simulation was not run.
        JobError, ResultFileError: one was killed, ran out of time or left no result.
    """
    if not refits:
        return []
    threshold = leading_above(refits[0].log_evidence)
    leading = [
        refit for refit in refits if refit.log_evidence + _may_gain(refit, baseline) > threshold
    ]
    if len(leading) < 2:
        return list(refits)
    logger.info("finer mesh and steps at the end of the refits that lead, the best first")
    own = {refit.cause.name: refit for refit in leading}
    failed: dict[str, Failure] = {}
    # The last change of the log evidence of those that were corrected, and how often they were.
    changed: dict[str, float] = {}
    taken = Counter[str]()
    again = leading[:_AT_FIRST]
    while again:
        # What time steps leave is simulated, too: that of the best is the extended model's.
        tasks = [_Task(r, finer.turned((r.cause,)).one) for r in again]
        ends = side_by_side(_corrected, tasks, executor.processes, executor.threads)
        for refit, end in zip(again, ends, strict=True):
            name = refit.cause.name
            taken[name] += 1
            changed[name] = 0.0
            if isinstance(end, Failure):
                failed[name] = end
            else:
                own[name] = _at_its_end(refit, end, baseline)
                changed[name] = own[name].log_evidence - refit.log_evidence
        contending = _contending(list(own.values()), changed)
        unsettled = [
            refit
            for refit in contending
            if abs(changed.get(refit.cause.name, np.inf)) >= SETTLED
            and taken[refit.cause.name] < _CORRECTIONS
        ]
        again = unsettled if len(contending) > 1 else []
        again = again or _next_uncorrected(list(own.values()), taken)
    for refit in leading:
        if taken[refit.cause.name]:
            _tell(refit, own[refit.cause.name], failed.get(refit.cause.name))
    others = [refit for refit in refits if refit not in leading]
    return sorted([*own.values(), *others], key=lambda refit: -refit.log_evidence)


def leading_above(best: float) -> float:
    """Return log evidence above which a refit leads beside the best one."""
    return max(best - max(REACH, REACH_OF_LARGE * best), 0.0)


def _may_gain(refit: Refit, baseline: Evaluation) -> float:
    """Return what a correction at its own end may bring a refit, as a log evidence.

    The derivatives of the correction at the baseline change it on the way to the end of the refit
    by r, beside what the fitted parameters do; on coarse cells what they leave out was as large.
    It takes up to 2 r √E from an excess misfit E (Cauchy and Schwarz), which is known to the
    scatter of noise, and a log evidence holds half of that. 0 for a correction without derivatives.
    """
    at = refit.fit.best
    excess = at.excess + np.sqrt(2.0 * at.residual.size)
    return float(np.sqrt(excess) * changed_on_the_way(refit.objective, baseline.values, at))


def _next_uncorrected(refits: Sequence[Refit], taken: Mapping[str, int]) -> list[Refit]:
    """Return the best two without a correction of their own where one of them is the second best.

    By how much the best leads is told, and both are to be what they are told to be.
    """
    second = sorted(refits, key=lambda refit: -refit.log_evidence)[1]
    if taken[second.cause.name]:
        return []
    left = [refit for refit in refits if not taken[refit.cause.name]]
    return sorted(left, key=lambda refit: -refit.log_evidence)[:_AT_FIRST]


def _contending(refits: Sequence[Refit], changed: Mapping[str, float]) -> list[Refit]:
    """Return the best refit and those that a correction may still bring before it.

    What a refit gains by all that are still to come is up to `_TO_COME` times the last gain, and by
    the next one no more than the last one took away; the first one of a refit changes no more than
    the largest of those that were taken.

    Args:
        refits: as far as they are corrected.
        changed: by which the last correction changed the log evidence, by the name of the cause.
    """
    largest = max(map(abs, changed.values()))
    best = max(refits, key=lambda refit: refit.log_evidence)

    def gain(refit: Refit) -> float:
        last = changed.get(refit.cause.name)
        return largest if last is None else max(_TO_COME * last, -last)

    def loss(refit: Refit) -> float:
        return abs(changed.get(refit.cause.name, largest))

    return [
        refit
        for refit in refits
        if best.log_evidence - refit.log_evidence < REACH + gain(refit) + loss(best)
    ]


def _tell(before: Refit, after: Refit, failed: Failure | None) -> None:
    name, evidence = before.cause.name, before.log_evidence
    told = "as it was" if after is before else f"→ {after.log_evidence:+.1f}"
    why = "" if failed is None else f", for its end cannot be simulated ({failed.why})"
    logger.info(f"  {name}: log evidence {evidence:+.1f} {told}{why}")


def corrected_refit(
    refit: Refit,
    finer: ForwardModel,
    baseline: Evaluation,
    most: int,
    left: StepError | None = None,
) -> Refit | Failure:
    """Return a refit under the correction where it stands, or why there is none.

    Args:
        refit: the refit.
        finer: the finer model, its orientations those of the refit.
        baseline: the baseline at its optimum.
        most: largest number of iterations.
        left: what time steps leave wrong at the baseline, where that is known.

    Raises:
        NotRunError: a simulation was not run.
        JobError, ResultFileError: one was killed, ran out of time or left no result.
    """
    end = _corrected(_Task(refit, finer, most, left_elsewhere(left, baseline, refit.fit.best)))
    return end if isinstance(end, Failure) else _at_its_end(refit, end, baseline)


def left_elsewhere(
    left: StepError | None, baseline: Evaluation, at: Evaluation
) -> StepError | None:
    """Return what time steps leave wrong where a cause stands; None where that is to be simulated.

    It hardly hangs on the cause, but on the steps that were cut.

    Args:
        left: what they leave at the baseline, if known.
        baseline: the baseline.
        at: where the cause stands.
    """
    as_many = at.prediction.response.ends.size == baseline.prediction.response.ends.size
    return left if as_many else None


@quiet()
def _corrected(task: _Task) -> _End | Failure:
    """Return a refit under the correction where it stands, or why there is none."""
    refit, at = task.refit, task.refit.fit
    # With derivatives of its own: those at the baseline left 0.7 σ of own error in the demo.
    change = attempt(
        lambda: correction(
            refit.objective.model,
            task.finer,
            at.best.prediction,
            at.values,
            free=at.best.free,
            near=refit.objective.correction,
            left_by_steps=task.left,
        )
    )
    if isinstance(change, Failure):
        return change
    return _End(change, fit_from(at.best, _under(change, refit), task.most, TOLERANCE))


def _at_its_end(refit: Refit, end: _End, baseline: Evaluation) -> Refit:
    """Return the refit that a process has corrected."""
    corrected = refit_of(refit.cause, _under(end.change, refit), end.fit, baseline)
    return replace(corrected, corrected="at its end")


def _under(change: Correction, refit: Refit) -> Objective:
    """Return the objective of a refit with the correction at its own end."""
    return under(change, with_prior(refit.objective, refit.cause))


def under(change: Correction, objective: Objective) -> Objective:
    """Return an objective with another correction.

    Args:
        change: finer minus working prediction elsewhere.
        objective: the objective.
    """
    # What the second mesh adds stays: of those that lead it is taken at their ends later.
    whole = change.with_second(objective.second).completed_by(objective.correction)
    return replace(objective, correction=whole)
