"""Looks from afar at causes whose effect bends.

A score is of first order. Far from its null such a cause does something else than near it: of the
effect of a few prior scales hardly anything lies along the derivative at the null, and the data
do not show it there. It is scored as well by the change of the prediction from the fit to where it
stands three prior scales off its null, on either side; where that promises something, by what a
refit from there gains.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from driver.diagnosis.causes import NUMERICS, Cause
from driver.diagnosis.refit import (
    FAR,
    MOST_FROM_AFAR,
    Crew,
    Refit,
    Start,
    refit_from,
    with_prior,
)
from driver.diagnosis.score import NAMING_LEVEL, WORTH, Score, score, significance
from driver.identification.fit import Fit
from driver.identification.objective import Evaluation, Objective
from driver.log import Log
from solver_adapters.interface import NotRunError, SolverError
from solver_adapters.jobs.errors import is_by_circumstances

PROMISING = 0.02  # probability of one look under the null, below which a refit follows
_LOOKS = 3  # either side, and where a refit ends


@dataclass(frozen=True, eq=False)
class FarLooks:
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
    """The fit with a cause off its null by an amount, in prior scales, and its score."""

    amount: float
    at: Evaluation
    score: Score


def look_from_afar(
    scores: Sequence[Score],
    here: Fit,
    objective: Objective,
    variance: float,
    accepted: bool,
    crew: Crew,
) -> FarLooks:
    """Score causes that bend from afar.

    Those that hide come first, where their derivative does not show them; the others where
    something is wrong (the tests reject, or a cause is seen by its derivative or from afar) and
    they do not lead already. Each costs two simulations, and a refit where they promise something.

    Args:
        scores: of all causes, to first order.
        here: the fit that is examined.
        objective: its objective.
        variance: of whitened numbers along the causes, 1 for noise alone.
        accepted: whether the tests of the residual against no particular cause accept.
        crew: who refits; its log takes a line for each cause, and for a side that fails.

    Raises:
        NotRunError: a simulation was not run.
        JobError, ResultFileError: one was killed, ran out of memory or left no result.
    """
    leader = next((s for s in scores if s.cause != NUMERICS), None)
    bent = [s for s in scores if s.cause.hides and not _shows(s)]
    bent += [s for s in scores if s.cause.bends and not s.cause.hides and s is not leader]
    family = len(scores) + _LOOKS * len(bent)
    seen, refits = list(scores), []

    def look(near: Score, at: Evaluation, amount: float) -> _Look:
        change = (here.best.residual - at.residual)[None] / amount
        degrees = objective.data.load_degrees
        return _Look(amount, at, score(near.cause, change, here.best, family, degrees, variance))

    for near in bent:
        right = accepted and all(s.p >= NAMING_LEVEL for s in seen if s.cause != NUMERICS)
        if right and not near.cause.hides:
            break
        crew.log(f"  looking at {near.cause.name} from afar")
        extended = with_prior(objective, near.cause)
        sides = [
            look(near, at, amount)
            for at, amount in _sides(near, here, extended, crew.log)
            if amount != 0.0
        ]
        promising = [
            one
            for one in sides
            if one.score.estimate[0] * one.amount > 0
            and chi2.sf(one.score.statistic, one.score.degrees) < PROMISING
        ]
        found = [near, *(one.score for one in promising)]
        if promising:
            begin = max(promising, key=lambda one: one.score.statistic)
            start = Start(
                near.cause, extended, begin.at.values, None, here.best, np.inf, MOST_FROM_AFAR
            )
            for refit in refit_from([start], crew):
                end = _gained(refit, begin.score, here, objective, family, variance)
                if abs(end.estimate[0]) > FAR[0]:
                    refits.append(refit)
                    found.append(end)
        best = max(found, key=lambda s: s.log_evidence)
        limits = [one.score.visible for one in sides]
        # Near the null the derivative holds, beyond it what the weaker side shows.
        if limits and near.visible[0] > FAR[0]:
            best = replace(best, visible=np.max(limits, axis=0))
        seen[seen.index(near)] = best
    return FarLooks(sorted(seen, key=lambda s: -s.log_evidence), refits)


def _gained(
    refit: Refit, side: Score, here: Fit, objective: Objective, family: int, variance: float
) -> Score:
    """The score that a refit is: its statistic is the likelihood ratio, one parameter more."""
    at, extended = refit.fit.best, with_prior(objective, refit.cause)
    amount = _amount(refit.cause, extended, at.values)
    # The cost of a refit has the prior of its cause.
    gained = max(here.best.cost - (at.cost - amount**2), 0.0) / variance
    components = np.array([np.copysign(np.sqrt(gained), amount)])
    p = significance(
        refit.cause, components, side.directions, here.best, family, objective.data.load_degrees
    )
    (name,) = refit.cause.parameters
    k, width = at.free.index(name), extended.prior[name][1]
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
    """Whether the derivative shows a cause, in a size that is not absurd."""
    return near.p < NAMING_LEVEL and near.log_evidence > WORTH


def _sides(near: Score, here: Fit, extended: Objective, log: Log) -> list[tuple[Evaluation, float]]:
    """The fit with a cause far off its null, and how far, where that can be simulated."""
    (name,) = near.cause.parameters
    null, width = extended.prior[name]
    model, found = extended.near(here.best).model, []
    for amount in (FAR[-1], -FAR[-1]):
        values = here.values | {name: extended.parameters[name].value(amount * width, null)}
        try:
            prediction = model.predict(values, ())
        except NotRunError:
            raise
        except (SolverError, ValueError) as error:
            if is_by_circumstances(error):
                raise
            why = str(error).partition("\n")[0]
            log(f"  {name} = {values[name]:.3g} cannot be simulated ({why})")
            continue
        at = extended.compare(prediction, values, ())
        found.append((at, _amount(near.cause, extended, values)))
    return found


def _amount(cause: Cause, extended: Objective, values: Mapping[str, float]) -> float:
    """How many prior scales a cause is off its null."""
    (name,) = cause.parameters
    null, width = extended.prior[name]
    return float(extended.parameters[name].theta(values[name], null)) / width
