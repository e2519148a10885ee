"""The refits that lead, each under the correction at its own end.

What the working mesh gets wrong depends on where crystals yield, and that on the cause: of causes
that do much the same the correction at the baseline may favour the wrong one by several units of
log evidence. Its derivatives tell the most of that, but not far from there: it is taken again until
the evidence settles.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace

from driver.common.outcomes import Failure, attempt
from driver.common.parallel import side_by_side
from driver.common.progress import quiet
from driver.diagnosis.answer.result_types import Refit
from driver.diagnosis.search.fine_models import FineModels
from driver.diagnosis.search.refit import TOLERANCE, Executor, refit_of, with_prior
from driver.forward.model import ForwardModel
from driver.identification.correction import correction
from driver.identification.fit import fit_from
from driver.identification.objective import Evaluation

logger = logging.getLogger(__name__)

REACH = 10.0
"""Log evidence below the best within which a correction may change the order."""
REACH_OF_LARGE = 0.15
"""The same as a share of a large one: what derivatives do not hold grows with the effect."""
_MOST = 3  # iterations
_CORRECTIONS = 5  # of one refit
_SETTLED = 1.0  # change of the log evidence by the last of them


@dataclass(frozen=True, eq=False)
class _Task:
    """A refit, to be fitted again.

    Attributes:
        refit: the refit, under the correction at the baseline.
        finer: the finer model, its orientations those of the refit.
        baseline: the baseline at its optimum.
    """

    refit: Refit
    finer: ForwardModel
    baseline: Evaluation


def with_candidate_corrections(
    refits: Sequence[Refit], baseline: Evaluation, finer: FineModels, executor: Executor
) -> list[Refit]:
    """Refits, best evidence first, those that lead under the correction at their own end.

    Where one leads alone nothing is simulated: what it gains no correction takes away. One whose
    end the finer model cannot simulate stays as it was, and the log says so.

    Args:
        refits: the refits, best evidence first.
        baseline: the baseline at its optimum.
        finer: the finer models.
        executor: who refits.
    """
    if not refits:
        return []
    best = refits[0].log_evidence
    threshold = max(best - max(REACH, REACH_OF_LARGE * best), 0.0)
    leading = [refit for refit in refits if refit.log_evidence > threshold]
    if len(leading) < 2:
        return list(refits)
    logger.info("finer mesh and steps at the end of each refit that leads")
    tasks = [_Task(refit, finer.turned((refit.cause,)).one, baseline) for refit in leading]

    def done(index: int, result: Refit | Failure) -> None:
        name, before = leading[index].cause.name, leading[index].log_evidence
        if isinstance(result, Failure):
            why = f"for it cannot be simulated ({result.why})"
            logger.info(f"  {name}: log evidence {before:+.1f} as it was, {why}")
        else:
            logger.info(f"  {name}: log evidence {before:+.1f} → {result.log_evidence:+.1f}")

    ends = side_by_side(_under_its_own, tasks, executor.processes, executor.threads, done)
    own = [a if isinstance(b, Failure) else b for a, b in zip(leading, ends, strict=True)]
    others = [refit for refit in refits if refit not in leading]
    return sorted([*own, *others], key=lambda refit: -refit.log_evidence)


@quiet()
def _under_its_own(task: _Task) -> Refit | Failure:
    """Return the refit under the correction at its end, or why there is none."""
    refit = task.refit
    for _ in range(_CORRECTIONS):
        corrected = _corrected(refit, task)
        if isinstance(corrected, Failure):
            return corrected
        change = corrected.log_evidence - refit.log_evidence
        refit = corrected
        if abs(change) < _SETTLED:
            break
    return refit


def _corrected(refit: Refit, task: _Task) -> Refit | Failure:
    """Return a refit under the correction where it stands, or why there is none."""
    objective, at = with_prior(refit.objective, refit.cause), refit.fit
    change = attempt(
        lambda: correction(
            objective.model, task.finer, at.best.prediction, at.values, free=at.best.free
        )
    )
    if isinstance(change, Failure):
        return change
    # What the other mesh adds is that at the baseline: small beside what this changes.
    mean = change.mean_with(objective.spread).completed_by(objective.correction)
    objective = replace(objective, correction=mean)
    result = fit_from(at.best, objective, _MOST, TOLERANCE)
    return refit_of(refit.cause, objective, result, task.baseline)
