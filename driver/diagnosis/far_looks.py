"""Looks from afar at causes whose effect bends.

A score is of first order. Far from its null such a cause does something else than near it: of the
effect of a few prior scales hardly anything lies along the derivative at the null, and the data
do not show it there. It is scored as well by the change of the prediction from the fit to where it
stands three prior scales off its null, on either side; where that promises something, by the
change to where a refit from there ends.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from scipy.stats import chi2

from driver.diagnosis.refit import FAR, MOST_FROM_AFAR, TOLERANCE, Refit, refit_of, with_prior
from driver.diagnosis.score import NAMING_LEVEL, Score, score
from driver.identification.fit import Fit, fit
from driver.identification.objective import Evaluation, Objective
from driver.log import Log, silent
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
    scores: Sequence[Score], here: Fit, objective: Objective, variance: float, log: Log
) -> FarLooks:
    """Score causes that bend from afar as well; two simulations each, and a refit where it pays.

    Args:
        scores: of all causes, to first order.
        here: the fit that is examined.
        objective: its objective.
        variance: of whitened numbers along the causes, 1 for noise alone.
        log: takes a line for each that shows from afar, and for a side that fails.

    Raises:
        NotRunError: a simulation was not run.
    """
    bent = [s for s in scores if s.cause.bends and s.degrees]
    family = len(scores) + 2 * len(bent)
    seen, refits = {s.cause.name: s for s in scores}, []

    def held(near: Score, there: Evaluation, amount: float) -> Score:
        """The score along the change from the fit, at `amount` prior scales."""
        change = (here.best.residual - there.residual)[None] / amount
        degrees = objective.data.load_degrees
        return score(near.cause, change, here.best, family, degrees, variance)

    for near in bent:
        known: list[tuple[Score, Evaluation]] = []
        for amount in (FAR[-1], -FAR[-1]):
            there = _at(near, here, objective, amount, log)
            if there is None:
                continue
            far = held(near, there, amount)
            if float(far.estimate[0]) * amount > 0:
                known.append((far, there))
        if not known:
            continue
        far, there = max(known, key=lambda pair: pair[0].statistic)
        if near.p >= NAMING_LEVEL and chi2.sf(far.statistic, far.degrees) < PROMISING:
            extended = with_prior(objective, near.cause)
            free = (*here.best.free, *near.cause.parameters)
            ended = fit(extended, there.values, free, MOST_FROM_AFAR, silent, tolerance=TOLERANCE)
            refit = refit_of(near.cause, extended, ended, here.best)
            amount = _amount(near, extended, ended.values)
            if abs(amount) > FAR[0]:
                refits.append(refit)
                far = max(far, held(near, ended.best, amount), key=lambda s: s.log_evidence)
                log(f"  {near.cause.name} from afar: log evidence {far.log_evidence:+.1f}, "
                    f"p {far.p:.2g}; refitted {refit.log_evidence:+.1f}")  # fmt: skip
        if far.log_evidence > near.log_evidence:
            seen[near.cause.name] = far
    return FarLooks(sorted(seen.values(), key=lambda s: -s.log_evidence), refits)


def _at(near: Score, here: Fit, objective: Objective, amount: float, log: Log) -> Evaluation | None:
    """The fit with a cause so many prior scales off its null, None where that has no answer."""
    extended, (name,) = with_prior(objective, near.cause), near.cause.parameters
    null, width = extended.prior[name]
    parameter = objective.parameters[name]
    value = parameter.value(amount * width, null)
    if not parameter.lower <= value <= parameter.upper:
        return None
    values = here.values | {name: value}
    try:
        return objective.compare(objective.model.predict(values, ()), values, ())
    except NotRunError:
        raise
    except (SolverError, ValueError) as error:
        log(f"  {name} = {value:.3g} cannot be simulated ({str(error).partition(chr(10))[0]})")
        return None


def _amount(near: Score, extended: Objective, values: dict[str, float]) -> float:
    (name,) = near.cause.parameters
    null, width = extended.prior[name]
    return float(extended.parameters[name].theta(values[name], null)) / width
