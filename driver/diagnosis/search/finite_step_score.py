"""Looks from afar at causes whose effect bends, and at those that lie somewhere.

A score is of first order. Far from its null such a cause does something else than near it: of the
effect of a few prior scales hardly anything lies along the derivative at the null, and the data
do not show it there. It is scored as well by the change of the prediction from the fit to where it
stands three prior scales off its null, on either side, under the correction taken there if it
promises something; where that does so beside the best cause that is known, by what a refit from
there gains. What puts a cause so near to its null that the derivative holds has nothing to say
beside it. Of a cause with a kink at its null it holds nowhere: that one is always looked at, a
third of a prior scale off its null as well, and counts there however small it is.

What lies somewhere, as a band across a grain, is looked at in its places (`looks_in_places`). Its
middle and its width are two more degrees of freedom in its significance.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from driver.common.outcomes import Failure, attempt
from driver.common.parallel import side_by_side
from driver.common.progress import collected_lines
from driver.diagnosis.answer.result_types import Refit
from driver.diagnosis.causes.causes import NUMERICS, Cause
from driver.diagnosis.causes.noise_causes import COVARIANCE
from driver.diagnosis.search.corrected_looks import refit_from_look, seen_corrected
from driver.diagnosis.search.looks import Side, Task, on_its_side, promises, seen_at
from driver.diagnosis.search.looks_in_places import SIDES, looks_in_places
from driver.diagnosis.search.refit import (
    FAR,
    MOST_FROM_AFAR,
    Executor,
    Start,
    added_by,
    refit_from,
    with_prior,
)
from driver.diagnosis.statistics.bayes_factor import amounts_of
from driver.diagnosis.statistics.score_test import NAMING_LEVEL, WORTH, Score, significance
from driver.forward.model import ForwardModel
from driver.forward.prediction import Prediction
from driver.identification.fit import Fit
from driver.identification.objective import Evaluation, Objective
from meshes.arrays import FloatArray

logger = logging.getLogger(__name__)

HOPEFUL = 0.5  # of the best log evidence of any cause so far, which a side has to promise as well
_SHOWN_IN_A_PLACE = 0.5
"""Share of the log evidence of its refit that a look has: 0.2 to 0.6 where both were seen.

Width and place are free in the refit."""
BESIDE_A_KINK = 1.0 / 3.0
"""Prior scales: of a lag 1 s, beyond the half second in which its rate changes (`load_at`)."""
_SURE = 2.0  # standard deviations by which an amount is known
_LOOKS = 2  # either side
_REFITS = 1  # where a refit ends
_MORE_OF_A_KINK = 2  # either side once more


@dataclass(frozen=True, eq=False)
class FiniteStepScores:
    """What is seen from afar.

    Attributes:
        scores: of all causes, that of a bent one from where it shows best; the magnitude from
            which on it is seen is that of a look.
        refits: of the bent causes that showed from afar.
    """

    scores: list[Score]
    refits: list[Refit]


@dataclass(frozen=True, eq=False)
class _Look:
    """What a look at one cause shows.

    Attributes:
        score: of the cause, from where it shows best.
        refits: of the cause, if it promised something.
        lines: what it told on its way.
    """

    score: Score
    refits: tuple[Refit, ...]
    lines: tuple[str, ...]


def finite_step_scores(
    scores: Sequence[Score],
    here: Fit,
    objective: Objective,
    finer: ForwardModel,
    variance: float,
    accepted: bool,
    executor: Executor,
) -> FiniteStepScores:
    """Score causes that bend from afar.

    Those that hide come first, where their derivative does not show them or has a kink. The others
    come where something is wrong (the tests reject, or a cause is seen by its derivative or from
    afar), and those that hide but do not here. Each costs two simulations and a finer one for each
    that promises something; one where its parameter is an instrument's; or two for each of its
    places, and a finer one for the two of these looks that promise most. A refit follows where
    they promise something beside the best cause so far.

    Args:
        scores: of all causes, to first order.
        here: the fit that is examined.
        objective: its objective.
        finer: the finer model behind its correction.
        variance: of whitened numbers along the causes, 1 for noise alone.
        accepted: whether the tests of the residual against no particular cause accept.
        executor: who looks, cause by cause.

    Raises:
        NotRunError: a simulation was not run.
        JobError, ResultFileError: one was killed, ran out of time or left no result.
    """
    hiding = [s for s in scores if s.cause.check_always and (s.cause.kinked or not _shows(s))]
    afar = [s for s in scores if s.cause.strongly_nonlinear or s.cause.places]

    def looked(bent: Sequence[Score], before: int, rivals: Sequence[Score]) -> list[_Look]:
        family = len(scores) + before + _tries(bent)
        least = max([WORTH, *(HOPEFUL * s.log_evidence for s in rivals)])
        tasks = [Task(near, here, objective, finer, family, variance, least) for near in bent]
        if tasks:
            logger.info(f"looking from afar at {', '.join(near.cause.name for near in bent)}")

        def done(index: int, result: _Look) -> None:
            for line in result.lines:
                logger.info(line)

        return side_by_side(_look, tasks, executor.processes, executor.threads, done)

    causes = [s for s in scores if s.cause != NUMERICS]
    looks = looked(hiding, 0, _of_the_mean(causes))
    seen = [s for s in causes if s not in hiding] + [look.score for look in looks]
    if not accepted or any(s.p < NAMING_LEVEL for s in seen):
        rest = [s for s in afar if s not in hiding]
        looks += looked(rest, _tries(hiding), _of_the_mean(seen))
    best = {s.cause.name: s for s in (*scores, *(look.score for look in looks))}
    refits = [refit for look in looks for refit in look.refits]
    return FiniteStepScores(sorted(best.values(), key=lambda s: -s.log_evidence), refits)


def _tries(bent: Sequence[Score]) -> int:
    """How many tries the looks at some causes are."""
    return sum(
        _REFITS
        + (len(SIDES) * len(s.cause.places) or _LOOKS)
        + (_MORE_OF_A_KINK if s.cause.kinked else 0)
        for s in bent
    )


def _of_the_mean(scores: Sequence[Score]) -> list[Score]:
    """Those of causes of the mean: what a covariance gains is no measure for them."""
    return [s for s in scores if s.cause not in COVARIANCE]


def _look(task: Task) -> _Look:
    """Both sides of a cause, in all places, and a refit from the look that promises most."""
    with collected_lines() as lines:
        best, refits = _best_score(task)
    return _Look(best, tuple(refits), tuple(lines))


def _best_score(task: Task) -> tuple[Score, list[Refit]]:
    """Return the score of a cause from where it shows best, and its refits."""
    near = task.near
    extended = with_prior(task.objective, near.cause)
    if near.cause.places:
        sides = looks_in_places(task, extended)
    else:
        sides = _both_sides(task, extended)
    promising = [
        one for one in sides if on_its_side(one) and _may_be_far(one.score) and promises(one)
    ]
    scores = [near, *(one.score for one in promising)]
    refits: list[Refit] = []
    worth = [one for one in promising if one.score.log_evidence > _least_evidence(task)]
    if near.cause.places:
        scores = [near]  # a place alone has neither the evidence nor the size of its refit
    if worth:
        # What a place shows without its correction is no measure beside what others show with it.
        begin = max(worth, key=lambda one: (one.is_corrected, one.score.statistic))
        refit = _refit(task, extended, begin)
        if refit is not None:
            end = _gained(refit, begin.score, task)
            # What the sides promise the refit has tried.
            scores = [near]
            # Where the correction is the cause's own, its derivative at the null never held.
            least = _least_amount(near.cause)
            if refit.has_own_correction:
                least = min(least, _SURE * end.sigma[0])
            if abs(end.estimate[0]) > least and refit.log_evidence > WORTH:
                refits.append(refit)
                scores.append(end)
    best = max(scores, key=lambda s: s.log_evidence)
    limits = _visible(near, sides)
    # Near the null the derivative holds unless it has a kink, beyond it what the weaker side shows.
    if limits and near.visible[0] > _least_amount(near.cause):
        best = replace(best, visible=np.max(limits, axis=0))
    # What is seen is not smaller than what is visible, though one side shows less than the other.
    if best.p < NAMING_LEVEL:
        best = replace(best, visible=np.minimum(best.visible, np.abs(best.estimate)))
    return best, refits


def _least_evidence(task: Task) -> float:
    """Return the log evidence that a look has to promise for a refit."""
    shown = _SHOWN_IN_A_PLACE if task.near.cause.places else 1.0
    return max(WORTH, shown * task.least)


def _both_sides(task: Task, extended: Objective) -> list[Side]:
    """Return the fit with a cause off its null, corrected where that promises something.

    By the correction at the fit a contrast of four prior scales stood within one of its null. What
    an instrument shows has no correction.
    """
    near = task.near
    (name,) = near.cause.parameters
    sides = [seen_at(task, at, n) for at, n in _sides(near, task.here, extended) if n]
    if not extended.model.simulated(name):
        return sides
    again = [place for place, s in enumerate(sides) if on_its_side(s) and promises(s)]
    return seen_corrected(task, extended, sides, again, name)


def _visible(near: Score, sides: Sequence[Side]) -> list[FloatArray]:
    """Return what would have been seen on either side, or in each place.

    Of a side that counts which of its looks shows most. The derivative is that of one place more.
    """
    if near.cause.places:
        return [near.visible, *(one.score.visible for one in sides)]
    groups = [[one for one in sides if (one.amount > 0) == above] for above in (True, False)]
    return [np.min([one.score.visible for one in group], axis=0) for group in groups if group]


def _may_be_far(side: Score) -> bool:
    """Whether it leaves the cause where its derivative does not hold."""
    return bool(np.abs(side.estimate[0]) + _SURE * side.sigma[0] > _least_amount(side.cause))


def _least_amount(cause: Cause) -> float:
    """Prior scales within which the derivative at the null holds."""
    return 0.0 if cause.kinked or cause.places else FAR[0]


def _refit(task: Task, extended: Objective, begin: Side) -> Refit | None:
    """Return the refit of a cause from the look that promises most; None if it is given up.

    Where it cannot be corrected what bends is fitted under the correction at the fit.
    """
    cause = task.near.cause
    (name,) = cause.parameters
    if task.objective.model.simulated(name):
        refit = refit_from_look(task, extended, begin)
        if refit is not None or cause.places:
            return refit
    values, fitted = begin.at.values, task.here.best
    start = Start(cause, extended, values, None, fitted, np.inf, MOST_FROM_AFAR)
    return next(iter(refit_from([start], Executor(1, 1))), None)


def _gained(refit: Refit, side: Score, task: Task) -> Score:
    """Return score that a refit is: its statistic is the likelihood ratio."""
    fitted, degrees = task.here.best, task.objective.data.load_degrees
    at = refit.fit.best
    (amount,) = amounts_of(refit.cause.parameters, at.values, task.objective)
    # The cost of a refit has the priors of its cause.
    rows = [at.free.index(name) for name in added_by(refit.cause, fitted)]
    of_cause = float(at.prior_weight[rows] @ at.prior_gap[rows] ** 2)
    gained = max(fitted.cost - (at.cost - of_cause), 0.0) / task.variance
    components = np.array([np.copysign(np.sqrt(gained), amount)])
    p = significance(refit.cause, components, side.directions, fitted, task.family, degrees)
    (name,) = refit.cause.parameters
    k, width = at.free.index(name), task.objective.parameters[name].width
    return replace(
        side,
        statistic=gained,
        p=p,
        log_evidence=refit.log_evidence,
        estimate=np.array([amount]),
        sigma=np.sqrt(refit.fit.covariance[[k], [k]]) / width,
        components=components,
    )


def _shows(near: Score) -> bool:
    """Whether the derivative shows a cause, and the evidence bears its size."""
    return near.p < NAMING_LEVEL and near.log_evidence > WORTH


def _sides(near: Score, here: Fit, extended: Objective) -> list[tuple[Evaluation, float]]:
    """Return the fit with a cause far off its null, and how far, where that can be simulated."""
    (name,) = near.cause.parameters
    null, parameter = extended.prior[name][0], extended.parameters[name]
    steps = (BESIDE_A_KINK, FAR[-1]) if near.cause.kinked else (FAR[-1],)
    amounts = [sign * step for step in steps for sign in (1.0, -1.0)]
    off = [
        here.values | {name: parameter.value(amount * parameter.width, null)} for amount in amounts
    ]
    ends = []
    for values, prediction in zip(off, _predicted(name, off, here, extended), strict=True):
        if isinstance(prediction, Failure):
            logger.info(f"  {name} = {values[name]:.3g} cannot be simulated ({prediction.why})")
            continue
        at = extended.compare(prediction, values, ())
        ends.append((at, float(amounts_of(near.cause.parameters, values, extended)[0])))
    return ends


def _predicted(
    name: str, off: Sequence[Mapping[str, float]], here: Fit, extended: Objective
) -> list[Prediction | Failure]:
    """Return the predictions with a parameter off its null; of an instrument's one run has all."""
    model = extended.warm_started_from(here.best).model

    def predicted(values: Mapping[str, float]) -> Prediction | Failure:
        return attempt(lambda: model.predict(values, ()))

    if model.simulated(name):
        return side_by_side(predicted, off, 1)
    first = predicted(off[0])
    if isinstance(first, Failure):
        return [first] * len(off)
    return [first, *(model.observe(first.response, values, ()) for values in off[1:])]
