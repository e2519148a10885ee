"""One descent of a fit: the Gauss–Newton step, shortened where it fails or leads nowhere lower."""

from __future__ import annotations

import logging
from collections.abc import Mapping

import numpy as np

from driver.common.errors import InputError
from driver.common.outcomes import first_line
from driver.identification.gauss_newton_step import bounded_step, trial_values
from driver.identification.objective import Evaluation, Objective
from meshes.arrays import FloatArray
from solver_adapters.interface import SolverError
from solver_adapters.jobs.errors import is_by_circumstances, is_out_of_time

logger = logging.getLogger(__name__)


MOST_HALVINGS, MOST_IF_FLAT = 5, 3  # lengths of a step that are tried
# Precise loads make a narrow valley that bends: a full step along it climbs its side, for the loads
# answer to second order, and one or two more steps lead down again. Steps short enough never to
# climb would go on for tens of iterations (watchdog: Chamberlain et al., Math. Prog. Study 16
# (1982) 1). From higher than this the way down may end in another valley.
MOST_CORRECTIONS = 2
HIGHEST = 10.0  # times the cost where the step began
SUFFICIENT = 0.1  # share of the promised fall that must have come at the end
KEPT = 0.25  # share of it that the higher point has to promise still, from where the step began
# Step control and iteration of a solver scatter the cost by hundredths. A step that promises less
# than a tenth and does not lower it, nor do two shorter ones, has met that scatter.
FLAT = 0.3
# The derivatives are those of the reference, without the noise of each image; the cost knows that
# noise and prefers places between pixels, where interpolation lowers it. This near to the optimum a
# step that takes half of the score away is right even where the cost does not fall.
SCORE = 3.0
# Two steps that change the cost by less than this share of what one of them does go to and fro.
SAME = 0.1


def newton(objective: Objective, at: Evaluation) -> tuple[FloatArray, float]:
    """Return the step in θ, shape (k,), that would end a linear fit, and its Newton decrement [σ].

    The decrement is that of the step without damping (`bounded_step`).
    """
    known = [objective.parameters[name] for name in at.free]
    return bounded_step(at.hessian, at.gradient, known, [at.values[name] for name in at.free])


def promised(objective: Objective, here: Evaluation) -> float:
    """Cost ‖r‖² + prior after the first step, were the model linear."""
    return promised_by(newton(objective, here)[0], here)


def promised_by(step: FloatArray, here: Evaluation) -> float:
    """Cost ‖r‖² + prior after a step in θ, shape (k,), were the model linear."""
    return here.cost - float(2 * here.gradient @ step - step @ here.hessian @ step)


def descend(
    objective: Objective,
    here: Evaluation,
    step: FloatArray,
    decrement: float,
) -> Evaluation | None:
    """Return the next point of a fit, None where no trial point leads lower.

    Args:
        objective: model and data, beginning each simulation beside `here`.
        here: where the step begins.
        step: in θ, shape (k,).
        decrement: Newton decrement of the step without damping [σ].

    Raises:
        SolverError: a simulation was not run, or ended for no reason of its parameters.
    """
    length = 1.0
    for _ in range(MOST_IF_FLAT if decrement < FLAT else MOST_HALVINGS):
        values = trial_values(here.values, here.free, length * step, objective.parameters)
        ahead = _tried(objective, values, here)
        if ahead is not None:
            if ahead.cost < here.cost:
                return ahead
            if decrement < SCORE and newton(objective, ahead)[1] < decrement / 2:
                return ahead
            if length == 1.0 and decrement >= FLAT:
                corrected = _corrected(objective, here, ahead, decrement)
                if corrected is not None:
                    return corrected
        length *= 0.4
    return None


def go_to_and_fro(before: float, here: float, ahead: float) -> bool:
    """Whether the second of two steps has taken back what the first did to the cost.

    Args:
        before: the cost where the first began.
        here: that between them.
        ahead: that where the second ended.
    """
    return abs(ahead - before) < SAME * abs(ahead - here)


def between(objective: Objective, here: Evaluation, ahead: Evaluation) -> Evaluation | None:
    """Return the point between two where the slope of the cost is that of neither, but null.

    Each step reaches too far: the curvature is larger than that of the Hessian. None where the
    slopes do not turn, or where a step from that point would be no shorter than from the two.

    Args:
        objective: model and data, beginning each simulation beside `here`.
        here: where the last step began.
        ahead: where it ended.
    """
    known = objective.parameters
    way = np.array([known[n].theta(ahead.values[n], here.values[n]) for n in here.free])
    first, last = float(here.gradient @ way), float(ahead.gradient @ way)
    if not last < 0.0 < first:
        return None
    values = trial_values(here.values, here.free, way * first / (first - last), known)
    found = _tried(objective, values, here)
    least = min(newton(objective, one)[1] for one in (here, ahead))
    if found is None or newton(objective, found)[1] >= least:
        return None
    return found


def _corrected(
    objective: Objective, here: Evaluation, ahead: Evaluation, decrement: float
) -> Evaluation | None:
    """Return the point well below `here` to which further full steps from `ahead`, above it, lead.

    None if they do not: then the step is to be shortened.
    """
    for count in range(1, MOST_CORRECTIONS + 1):
        if not ahead.cost < HIGHEST * here.cost:
            return None
        step, further = newton(objective, ahead)
        if ahead.cost - further**2 > here.cost - KEPT * decrement**2:
            return None
        values = trial_values(ahead.values, ahead.free, step, objective.parameters)
        following = _tried(objective.warm_started_from(ahead), values, here)
        if following is None or following.cost >= ahead.cost:
            return None
        if following.cost < here.cost - SUFFICIENT * decrement**2:
            logger.info(f"    the step climbs; {count} more brought it well below where it began")
            return following
        ahead = following
    return None


def _tried(
    objective: Objective, values: Mapping[str, float], here: Evaluation
) -> Evaluation | None:
    try:
        return objective.evaluate(values, here.free)
    except (SolverError, InputError) as error:
        if is_by_circumstances(error) and not is_out_of_time(error):
            raise  # a shorter step might not be run or be killed as well, and prove nothing
        logger.info(f"    a trial point failed, so that the step is shortened: {first_line(error)}")
        return None
