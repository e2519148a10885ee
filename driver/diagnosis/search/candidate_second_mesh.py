"""The refits that lead, each with what the second mesh adds at its own end.

What a mesh gets wrong depends on where crystals yield, and that on the cause. Of two causes that do
nearly the same, what the second mesh adds at the baseline favoured the wrong one by 5 units of log
evidence of 250; at their own ends they are as likely as each other.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from driver.common.outcomes import Failure, attempt
from driver.common.parallel import side_by_side
from driver.common.progress import quiet
from driver.diagnosis.answer.result_types import Refit
from driver.diagnosis.search.candidate_correction import REACH, REACH_OF_LARGE
from driver.diagnosis.search.fine_models import FineModels, added_by_second
from driver.diagnosis.search.refit import TOLERANCE, Executor, refit_of, with_prior
from driver.forward.model import ForwardModel
from driver.identification.correction import SecondMesh
from driver.identification.fit import Fit, fit_from
from driver.identification.objective import Evaluation, Objective

logger = logging.getLogger(__name__)

_MOST = 3  # iterations


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

    Where one leads alone, or one mesh has to do, nothing is simulated. Others follow the two best
    where as much as any of these has gained may bring them within reach of the best, or next to it.
    One whose end cannot be simulated stays as it was, and the log says so.

    Args:
        refits: the refits, best evidence first.
        baseline: the baseline at its optimum.
        finer: the finer models.
        executor: who refits.
    """
    if len(refits) < 2 or finer.make_second is None or refits[0].objective.second is None:
        return list(refits)
    most = refits[0].log_evidence
    if most - refits[1].log_evidence >= max(REACH, REACH_OF_LARGE * most):
        return list(refits)
    logger.info("the second mesh at the end of the refits that lead, the best first")
    own = {refit.cause.name: refit for refit in refits}
    gained: dict[str, float] = {}
    again = list(refits[:2])
    while again:
        ends = _with_second(again, finer, executor)
        for refit, end in zip(again, ends, strict=True):
            name, evidence = refit.cause.name, refit.log_evidence
            if isinstance(end, Failure):
                gained[name] = 0.0
                why = f"for it cannot be simulated ({end.why})"
                logger.info(f"  {name}: log evidence {evidence:+.1f} as it was, {why}")
                continue
            own[name] = refit_of(refit.cause, _under(end.second, refit), end.fit, baseline)
            gained[name] = own[name].log_evidence - evidence
            logger.info(f"  {name}: log evidence {evidence:+.1f} → {own[name].log_evidence:+.1f}")
        again = _next(own.values(), gained)
    return sorted(own.values(), key=lambda refit: -refit.log_evidence)


def _next(refits: Iterable[Refit], gained: Mapping[str, float]) -> list[Refit]:
    """Return those that may be the best, within reach of it or next to it.

    By how much the best leads is told, and both are to be what they are told to be.

    Args:
        refits: as far as they were fitted again.
        gained: log evidence that brought, by the name of the cause; the others may gain as much.
    """
    largest = max(0.0, *gained.values())

    def foreseen(refit: Refit) -> float:
        return refit.log_evidence + (0.0 if refit.cause.name in gained else largest)

    first, *others = sorted(refits, key=foreseen, reverse=True)
    near = [refit for refit in others if foreseen(first) - foreseen(refit) < REACH]
    return [r for r in (first, *(near or others[:1])) if r.cause.name not in gained]


def _with_second(
    refits: Sequence[Refit], finer: FineModels, executor: Executor
) -> list[_End | Failure]:
    """Return refits with what the second mesh adds where they stand, or why there are none."""
    tasks: list[_Task] = []
    for refit in refits:
        make = finer.turned((refit.cause,)).make_second
        assert make is not None
        made = attempt(make)
        if isinstance(made, Failure):
            return [made] * len(refits)
        tasks.append(_Task(refit, made, finer.size))
    return side_by_side(_fitted, tasks, executor.processes, executor.threads)


@quiet()
def _fitted(task: _Task) -> _End | Failure:
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
