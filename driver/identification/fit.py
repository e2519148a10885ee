"""Gauss–Newton on the whitened residual with a Gaussian prior (Hessian JJᵀ + P, J of shape (k, n)).

The variable of each parameter is θ (`Parameter.theta`): a logarithm or a scaled difference.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from time import monotonic

import numpy as np

from driver.identification.gauss_newton_step import is_at_bound
from driver.identification.line_search import (
    FLAT,
    SCORE,
    between,
    descend,
    go_to_and_fro,
    newton,
    promised_by,
)
from driver.identification.objective import Evaluation, Objective
from meshes.arrays import FloatArray
from solver_adapters.parameter import Parameter

logger = logging.getLogger(__name__)


DECREMENT = 0.1  # Newton decrement at convergence: a tenth of a standard deviation
# A model error leaves an excess misfit, and makes convergence slow (its residual is large where
# the model is curved). A step that would lower the excess by a hundredth changes no answer. What
# noise alone scatters by is no excess.
NEGLIGIBLE = math.sqrt(1e-2)
# Newton decrement at the optimum beside an excess, where the residual bends the cost as well: the
# steps go to and fro by half a standard deviation (alpha).
BESIDE_EXCESS = 0.3
SCATTER = 3.0  # standard deviations of ‖r‖²
POLISH = 8  # iterations of a fit that begins near its end
_LIMIT = "the limit of"
NEAR = 10.0
"""Newton decrement [σ] below which the trial points take the time steps of the last one: the cost
is then smooth, where steps of their own would make it jump by about as much as is to be gained."""


@dataclass(frozen=True, eq=False)
class Fit:
    """The end of a fit.

    Attributes:
        best: the evaluation at the optimum.
        converged: whether the Newton decrement became negligible.
        reason: why the iteration ended.
        history: values of the free parameters, cost and χ after each iteration.
        start_load: predicted readings where the fit began [µN], shape (T_all,); empty if it was
            not iterated.
        seconds: duration, wall clock.
        given_up: whether it ended because a step promised too little.
    """

    best: Evaluation
    converged: bool
    reason: str
    history: tuple[dict[str, float], ...]
    start_load: FloatArray = field(default_factory=lambda: np.empty(0))
    seconds: float = 0.0
    given_up: bool = False

    @property
    def at_limit(self) -> bool:
        """Whether the limit of its iterations ended it."""
        return self.reason.startswith(_LIMIT)

    @property
    def values(self) -> dict[str, float]:
        """Every parameter at the optimum."""
        return self.best.values

    def at_bounds(self, parameters: Mapping[str, Parameter]) -> tuple[str, ...]:
        """Names of the free parameters that stand at a bound."""
        return tuple(n for n in self.best.free if is_at_bound(parameters[n], self.values[n]))

    def inside(self, objective: Objective) -> Evaluation:
        """Return the fit with only that free which stands between its bounds.

        What is held at a bound follows nothing: along it the residual is seen, as along all that
        is not fitted.

        Args:
            objective: its priors count.
        """
        held = self.at_bounds(objective.parameters)
        return objective.restrict(self.best, [n for n in self.best.free if n not in held])

    @property
    def covariance(self) -> FloatArray:
        """Covariance H⁻¹ of θ, shape (k, k)."""
        return np.asarray(np.linalg.inv(self.best.hessian), dtype=np.float64)

    def away_from(self, start: Evaluation, parameters: Mapping[str, Parameter]) -> float:
        """Return how far from an evaluation the fit has ended [σ], by its Hessian."""
        there, here = start.values, self.values
        way = np.array([parameters[n].theta(here[n], there[n]) for n in self.best.free])
        return float(np.sqrt(way @ self.best.hessian @ way))

    def sigma(self, name: str, parameters: Mapping[str, Parameter]) -> float:
        """Return the standard deviation of a value (to first order)."""
        index = self.best.free.index(name)
        slope = parameters[name].slope(self.values[name])
        return float(np.sqrt(self.covariance[index, index]) * slope)


def fit(
    objective: Objective,
    values: Mapping[str, float],
    free: Sequence[str],
    most: int,
    start: Evaluation | None = None,
    tolerance: float = DECREMENT,
    share: float = 0.0,
    threshold: float = math.inf,
    negligible: float = NEGLIGIBLE,
) -> Fit:
    """Minimise the cost; a step that fails, or leads nowhere lower, is shortened.

    Args:
        objective: model and data.
        values: every parameter at the start.
        free: names of the parameters to identify.
        most: largest number of iterations.
        start: evaluation at `values` with `free`, where it is known already.
        tolerance: Newton decrement at which the fit has converged [σ].
        share: the fit also ends when a step lowers the cost, or would, by less than this share
            of it: enough for a fit that only starts another one.
        threshold: cost that each step has to promise; where one does not, the fit is given up.
        negligible: the fit also ends where a step would lower the excess misfit by less than the
            square of this share of it.

    Raises:
        SolverError: the model cannot be evaluated at the start.
        NotRunError: a simulation was not run: the solver is absent, or its job was prepared.
        JobError, ResultFileError: a simulation was killed, ran out of memory or left no result.
    """
    began = monotonic()
    current = start if start is not None else objective.evaluate(values, free)
    start_load, history = current.load, [_record(current)]

    def ended(converged: bool, reason: str, given_up: bool = False) -> Fit:
        logger.info(f"  {'ended' if converged else 'NOT converged'}: {reason}")
        seconds = monotonic() - began
        return Fit(current, converged, reason, tuple(history), start_load, seconds, given_up)

    _tell(0, current, None)
    iteration = 0
    before = math.inf  # cost where the last step but one began
    while True:
        step, decrement = newton(objective, current)
        if promised_by(step, current) > threshold:
            return ended(False, "a step promises too little", given_up=True)
        excess = max(current.excess - SCATTER * math.sqrt(2.0 * current.residual.size), 0.0)
        enough = max(tolerance, math.sqrt(share * current.cost), math.sqrt(excess) * negligible)
        if decrement < enough:
            return ended(True, _why_enough(decrement, tolerance, share * current.cost, excess))
        if iteration == most:
            reason = f"{_LIMIT} {most} iterations, decrement {decrement:.2g} σ"
            return ended(False, reason)
        flat = decrement < FLAT
        tried = (
            objective.with_time_steps_of(current) if decrement < NEAR else objective
        ).warm_started_from(current)
        ahead = descend(tried, current, step, decrement)
        if ahead is None and flat:
            return ended(True, f"a step of {decrement:.2g} σ does not lower the cost")
        if ahead is None:
            reason = f"no shorter step lowers the cost (decrement {decrement:.2g} σ)"
            return ended(False, reason)
        if go_to_and_fro(before, current.cost, ahead.cost):
            ahead = between(tried, current, ahead) or ahead
        gained = current.cost - ahead.cost
        fallen = gained / current.cost
        before, current, iteration = current.cost, ahead, iteration + 1
        history.append(_record(current))
        _tell(iteration, current, decrement)
        if 0 <= fallen < share:
            reason = f"the last step lowered the cost by {fallen:.1%}"
            return ended(True, reason)
        if 0 <= gained < tolerance**2:
            # Derivatives by differences may promise a gain for ever that never comes. One of many
            # σ that does not come is a fit that is stuck.
            found = f"the last step lowered the cost by {gained:.1g} only"
            return ended(decrement < SCORE, f"{found} (decrement {decrement:.2g} σ)")


def fit_from(at: Evaluation, objective: Objective, most: int, tolerance: float = DECREMENT) -> Fit:
    """Return a fit that begins where another objective has simulated: that prediction serves.

    Args:
        at: evaluation under an objective of the same model.
        objective: model and data, with another covariance, prior or correction.
        most: largest number of iterations.
        tolerance: Newton decrement at which the fit has converged [σ].
    """
    begin = objective.compare(at.prediction, at.values, at.free)
    return fit(objective, at.values, at.free, most, begin, tolerance)


def to_its_end(fitted: Fit, objective: Objective, most: int) -> Fit:
    """Return a fit that ended where a step changes little of an excess, taken to its optimum.

    What changes no answer of a diagnosis may still move a parameter by more than its σ. Where no
    step leads further the fit has ended as it had before.

    Args:
        fitted: the fit; one that has not converged is returned as it is.
        objective: its objective.
        most: largest number of iterations.
    """
    here = fitted.best
    if not fitted.converged or newton(objective, here)[1] < BESIDE_EXCESS:
        return fitted
    end = fit(objective, here.values, here.free, most, here, BESIDE_EXCESS, negligible=0.0)
    return replace(
        end,
        converged=True,
        reason=end.reason if end.converged else fitted.reason,
        history=(*fitted.history, *end.history[1:]),
        start_load=fitted.start_load,
        seconds=fitted.seconds + end.seconds,
    )


def _why_enough(decrement: float, tolerance: float, begun: float, excess: float) -> str:
    """Return why a fit may end with a Newton decrement [σ], whose square a step would gain.

    Args:
        decrement: as it is.
        tolerance: below which it tells by itself.
        begun: gain below which a fit that only starts another one ends.
        excess: misfit beyond the scatter of noise.
    """
    found = f"the Newton decrement is {decrement:.2g} σ"
    if decrement < tolerance:
        return found
    if decrement**2 < begun:
        return (
            f"{found}, so that a step would gain {decrement**2:.2g}, little beside the misfit of a "
            "fit that only starts the next one"
        )
    return (
        f"{found}, so that a step would gain {decrement**2:.2g}, less than {NEGLIGIBLE**2:.0%} of "
        f"the misfit beyond noise, {excess:.3g}, which no parameter takes away"
    )


def _record(here: Evaluation) -> dict[str, float]:
    record = {name: here.values[name] for name in here.free}
    return record | {
        "cost": here.cost, "chi_load": here.chi_load, "chi_image": here.chi_image,
        "paper_chi": here.paper.chi, "paper_chi_f": here.paper.chi_f,
        "paper_chi_F": here.paper.chi_F,
    }  # fmt: skip


def _tell(iteration: int, here: Evaluation, decrement: float | None) -> None:
    loads = f"χ_F {here.chi_load:7.2f}  " if here.n_load else ""
    images = f"χ of images {here.chi_image:.3f}" if here.residual.size > here.n_load else ""
    step = "" if decrement is None else f"  step {decrement:.3g} σ"
    logger.info(f"  iteration {iteration}: {loads}{images}{step}")
    for note in here.prediction.response.notes:
        logger.info(f"    {note}")
