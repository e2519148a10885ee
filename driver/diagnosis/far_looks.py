"""Looks from afar at causes whose effect bends.

A score is of first order. Far from its null such a cause does something else than near it: of the
effect of a few prior scales hardly anything lies along the derivative at the null, and the data
do not show it there. It is scored as well by the change of the prediction from the fit to where it
stands three prior scales off its null, on either side; where that promises something, by the
change to where a refit from there ends.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from driver.diagnosis.refit import (
    FAR,
    MOST_FROM_AFAR,
    Crew,
    Refit,
    Start,
    refit_from,
    with_prior,
)
from driver.diagnosis.score import NAMING_LEVEL, Score, score
from driver.identification.fit import Fit
from driver.identification.objective import Evaluation, Objective
from driver.log import Log
from solver_adapters.interface import NotRunError, SolverError

PROMISING = 0.02  # probability of one look under the null, below which a refit follows


@dataclass(frozen=True, eq=False)
class FarLooks:
    """What is seen from afar.

    Attributes:
        scores: of all causes, that of a bent one from where it shows best.
        refits: of the bent causes that showed from afar.
    """

    scores: list[Score]
    refits: list[Refit]


def look_from_afar(
    scores: Sequence[Score], here: Fit, objective: Objective, variance: float, crew: Crew
) -> FarLooks:
    """Score causes that bend from afar as well; two simulations each, and a refit where it pays.

    Args:
        scores: of all causes, to first order.
        here: the fit that is examined.
        objective: its objective.
        variance: of whitened numbers along the causes, 1 for noise alone.
        crew: who refits; its log takes a line for each cause that shows from afar, and for a side
            that fails.

    Raises:
        NotRunError: a simulation was not run.
    """
    bent = [s for s in scores if s.cause.bends and s.degrees]
    family = len(scores) + 2 * len(bent)
    seen, refits = list(scores), []

    def along(near: Score, there: Evaluation, amount: float) -> Score:
        """The score of the change from the fit, `amount` prior scales of the cause."""
        change = (here.best.residual - there.residual)[None] / amount
        degrees = objective.data.load_degrees
        return score(near.cause, change, here.best, family, degrees, variance)

    for near in bent:
        extended = with_prior(objective, near.cause)
        known: list[tuple[Score, Evaluation]] = []
        for amount in (FAR[-1], -FAR[-1]):
            there = _at(near, here, extended, amount, crew.log)
            far = None if there is None else along(near, there, amount)
            if there is not None and far is not None and far.estimate[0] * amount > 0:
                known.append((far, there))
        if not known:
            continue
        far, there = max(known, key=lambda pair: pair[0].statistic)
        found = [near, far]
        if near.p >= NAMING_LEVEL and chi2.sf(far.statistic, far.degrees) < PROMISING:
            crew.log(f"{near.cause.name} shows from afar: refitting it")
            start = Start(
                near.cause, extended, there.values, None, here.best, np.inf, MOST_FROM_AFAR
            )
            for refit in refit_from([start], crew):
                amount = _amount(near, extended, refit.fit.values)
                if abs(amount) > FAR[0]:
                    refits.append(refit)
                    found.append(along(near, refit.fit.best, amount))
        seen[seen.index(near)] = max(found, key=lambda s: s.log_evidence)
    return FarLooks(sorted(seen, key=lambda s: -s.log_evidence), refits)


def _at(near: Score, here: Fit, extended: Objective, amount: float, log: Log) -> Evaluation | None:
    """The fit with a cause so many prior scales off its null, None where that has no answer."""
    (name,) = near.cause.parameters
    null, width = extended.prior[name]
    parameter = extended.parameters[name]
    value = parameter.value(amount * width, null)
    if not parameter.lower <= value <= parameter.upper:
        return None
    values = here.values | {name: value}
    try:
        return extended.compare(extended.model.predict(values, ()), values, ())
    except NotRunError:
        raise
    except (SolverError, ValueError) as error:
        log(f"  {name} = {value:.3g} cannot be simulated ({str(error).partition(chr(10))[0]})")
        return None


def _amount(near: Score, extended: Objective, values: Mapping[str, float]) -> float:
    """How many prior scales a cause is off its null."""
    (name,) = near.cause.parameters
    null, width = extended.prior[name]
    return float(extended.parameters[name].theta(values[name], null)) / width
