"""Which causes are refitted: those that a score shows, and where these do not do it, others."""

from __future__ import annotations

import logging
from collections.abc import Sequence

from driver.diagnosis.answer.result_types import Refit
from driver.diagnosis.causes.causes import NUMERICS
from driver.diagnosis.causes.noise_causes import COVARIANCE
from driver.diagnosis.search.noise_continuation import refit_by_noise_continuation
from driver.diagnosis.search.refit import HOPEFUL, Executor, refit_causes, refit_from_afar
from driver.diagnosis.statistics.model_comparison import is_excess, share_explained
from driver.diagnosis.statistics.score_test import NAMING_LEVEL, WORTH, Score, subspace_similarity
from driver.identification.line_search import newton
from driver.identification.objective import Evaluation, Objective

logger = logging.getLogger(__name__)

LARGE = 3.0  # χ_F beyond which a score names a cause no better than chance
LOST = 10.0  # Newton decrement of a baseline that no refit should begin with [σ]
ENOUGH = 0.9  # share of the excess that the best cause has to explain
_NEAR = 1.0  # Newton decrement of a refit whose log evidence is right to a half [σ]
_AKIN = 0.5  # likeness of causes that may do for each other
_STRAIGHT = 0.5  # of a log evidence, by which score and refit may differ
_RIVAL = 0.75  # of the log evidence of the best score, with which a cause is refitted in any case


def refits_of_likely(
    scores: Sequence[Score],
    afar: Sequence[Refit],
    screening: Evaluation,
    baseline: Evaluation,
    objective: Objective,
    most: int,
    executor: Executor,
) -> list[Refit]:
    """Refits of the causes that may have done it, the best of each, best evidence first.

    Args:
        scores: of all causes, best log evidence first.
        afar: refits of causes that show from afar.
        screening: evaluation at the baseline with the parameters of every cause free.
        baseline: the baseline at its optimum.
        objective: its objective.
        most: largest number of causes that are refitted first.
        executor: who refits.

    Raises:
        SolverError: a simulation could not be finished.
    """
    tried = [s for s in scores if s.cause not in (NUMERICS, *COVARIANCE) and s.degrees]
    # What has begun where it shows has a correction of its own, by which others are not to be
    # measured; and of what lies somewhere, or bends, its null says nothing.
    apart = {refit.cause for refit in afar if refit.has_own_correction}
    from_null = [s for s in tried if s.cause not in apart]
    # Beside each other they are likely as all are, and vouch for what is akin to them.
    beside, without = to_refit(tried, most), to_refit(from_null, most)
    chosen = [s for s in from_null if s in beside or s in without]
    large = baseline.chi_load > LARGE
    # Where the baseline itself has come to no end no derivative holds.
    lost = large and newton(objective, baseline)[1] > LOST
    best: list[Refit] = []
    if not lost:
        if chosen:
            logger.info(f"refitting {_listed(chosen)}")
        refits = refit_causes(chosen, screening, baseline, objective, executor)
        shown = [s for s in tried if s.cause in apart and (s.p < NAMING_LEVEL or s in beside)]
        counted = [s.cause for s in (*shown, *chosen)]
        best = best_of_each([*refits, *(r for r in afar if r.cause in counted)])
    if large and tried and not _explained(baseline, best):
        soft = refit_by_noise_continuation(
            tried, screening.free, baseline, objective, most, executor
        )
        best = best_of_each([*best, *afar, *soft])
    every = (large and not lost) or bool(best and not _explained(baseline, best))
    if every:
        known = {refit.cause for refit in best} | apart
        others = [s for s in tried if s.cause not in known]
        logger.info(f"a large effect, or one half explained: refitting {_listed(others)}")
        threshold = cost_to_promise([r for r in best if r.cause not in apart], baseline)
        more = refit_causes(others, screening, baseline, objective, executor, threshold)
        best = best_of_each([*best, *afar, *more])
    bent = bool(best) and not large and _bent(best[0], scores)
    if bent:
        # Scores tell no more in which order refits come, nor do first steps what they gain.
        known = {refit.cause for refit in best} | apart
        worth = [s for s in tried[:most] if s.log_evidence > WORTH]
        likely = [s for s in tried if s.p < NAMING_LEVEL or s in worth]
        others = [s for s in likely if s.cause not in known]
        if others:
            logger.info(f"the best is another one than its score: refitting {_listed(others)}")
        more = refit_causes(others, screening, baseline, objective, executor)
        looked = (refit for refit in afar if refit.cause in {s.cause for s in likely})
        best = best_of_each([*best, *looked, *more])
    if not best:
        return []
    stalled = {r.cause.name for r in best if is_far_from_its_end(r)}
    # Soft loads were another start than a baseline that is lost.
    far = every if large else bent
    leading = {r.cause.name for r in best[:most]} if far else set()
    again = [s for s in tried if s.cause.name in stalled | leading and s.cause not in apart]
    if again:
        logger.info(f"from other starts: {_listed(again)}")
        threshold = cost_to_promise([r for r in best if r.cause not in apart], baseline)
        best = best_of_each(
            [*best, *refit_from_afar(again, baseline, objective, executor, threshold)]
        )
    return best


def to_refit(tried: Sequence[Score], most: int) -> list[Score]:
    """Return the causes that are seen, and those akin to one that promise about as much.

    Of likely causes that do nearly the same, noise makes one or the other significant. What a
    cause promises that has nothing to do with those that are seen is noise.

    Args:
        tried: scores, best log evidence first.
        most: largest number of either, close rivals of the best aside.
    """
    seen = [s for s in tried if s.p < NAMING_LEVEL]
    if not seen:
        return []
    best = tried[0].log_evidence
    # Refits come in another order than scores that differ by less than refit and score do.
    seen = [s for k, s in enumerate(seen) if k < most or s.log_evidence > _RIVAL * best]
    threshold = HOPEFUL * best
    if all(s.log_evidence <= threshold for s in seen):
        return seen  # they are of a size beyond all that is usual, and vouch for no other
    hopeful = [s for s in tried[:most] if s not in seen and s.log_evidence > threshold]
    akin = [s for s in hopeful if any(subspace_similarity(s, other) > _AKIN for other in seen)]
    return [s for s in tried if s in seen or s in akin]


def _explained(baseline: Evaluation, best: Sequence[Refit]) -> bool:
    return bool(best) and not leaves_unexplained(baseline, best[0])


def leaves_unexplained(baseline: Evaluation, best: Refit) -> bool:
    """Whether the best cause explains too little of the excess, and leaves more than noise."""
    # Of a small excess noise alone leaves more than a tenth.
    return share_explained(baseline, best.fit.best) < ENOUGH and is_excess(best.fit.best)


def is_far_from_its_end(refit: Refit) -> bool:
    """Whether a refit has stalled, and another start may tell more of its cause.

    One that only ran out of iterations beside its optimum has not.
    """
    return not refit.fit.converged and newton(refit.objective, refit.fit.best)[1] > _NEAR


def cost_to_promise(best: Sequence[Refit], baseline: Evaluation) -> float:
    """Cost that a first step has to promise: half of what the best refit gains."""
    lowest = min((refit.fit.best.cost for refit in best), default=baseline.cost)
    return lowest + (1.0 - HOPEFUL) * max(baseline.cost - lowest, 0.0)


def best_of_each(refits: Sequence[Refit]) -> list[Refit]:
    """Return the refit of least cost of each cause, best evidence first."""
    by_name: dict[str, Refit] = {}
    for one in refits:
        before = by_name.get(one.cause.name)
        if before is None or one.fit.best.cost < before.fit.best.cost:
            by_name[one.cause.name] = one
    return sorted(by_name.values(), key=lambda refit: -refit.log_evidence)


def _bent(leader: Refit, scores: Sequence[Score]) -> bool:
    """Whether the model bends so much on the way to a refit that another start may end elsewhere.

    Along a straight way the refit has the log evidence of the score.
    """
    foreseen = next(s.log_evidence for s in scores if s.cause.name == leader.cause.name)
    return abs(leader.log_evidence - foreseen) > _STRAIGHT * max(foreseen, leader.log_evidence)


def _listed(scores: Sequence[Score]) -> str:
    return ", ".join(s.cause.name for s in scores)
