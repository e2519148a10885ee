"""What the fit of an experiment leaves of an effect, its noise taken out by the known truth."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.blind_ruler import identified, shown
from driver.diagnosis.causes.causes import Cause
from driver.diagnosis.statistics.bayes_factor import prior_scaled
from driver.diagnosis.statistics.score_test import score
from driver.virtual.truth import Course


@dataclass(frozen=True)
class Left:
    """What the fit of an experiment leaves of what was hidden [σ].

    Attributes:
        whole: of the whole effect, along what a fit cannot take of it.
        like_itself: of each cause, what looks like it.
        beside: the same with the other causes in the model, each of any size, to first order: of
            one that bends a part stays.
    """

    whole: float
    like_itself: tuple[float, ...]
    beside: tuple[float, ...]


def left_of(path: Path, course: Course, unaffected: Course, causes: tuple[Cause, ...]) -> Left:
    """Projected misfit of an experiment that has been identified, and of each of some causes [σ].

    Of the residual of the fit the part that is not noise: of the whole effect that along what the
    effect leaves of the motion and the load, of a cause that which looks like it, the
    noncentrality of its score. What the simulation gets wrong counts no further than it looks like
    the effect. The nonlinear fit may take more of an effect than the ruler thinks, and images
    answer to a large one less than in proportion.

    Args:
        path: the case.
        course: what happened.
        unaffected: what had happened without the effect.
        causes: the causes.
    """
    objective, values, free = identified(path)
    names = [name for cause in causes for name in cause.parameters]
    augmented = objective.evaluate(values, tuple(dict.fromkeys([*free, *names])))
    objective, augmented = objective.with_pattern_at(augmented)
    fitted = objective.restrict(augmented, free)
    data, known = objective.data, objective.parameters
    true = shown(course, objective)
    excess = fitted.residual - data.residual(true, course.load)[0]
    effect = data.change(true - shown(unaffected, objective), course.load - unaffected.load)
    J = fitted.jacobian
    along = effect - J.T @ np.linalg.solve(fitted.hessian, J @ effect)
    whole = max(float(along @ excess), 0.0) / float(np.linalg.norm(along))
    like_itself: list[float] = []
    beside: list[float] = []
    for cause in causes:
        rows = [augmented.free.index(name) for name in cause.parameters]
        per_scale = prior_scaled(augmented.jacobian[rows], cause.parameters, known)
        others = [n for n in augmented.free if n not in cause.parameters]
        for at, found in ((fitted, like_itself), (objective.restrict(augmented, others), beside)):
            # Its directions are perpendicular to all that the fit can take, priors aside.
            directions = score(cause, per_scale, at, 1).directions
            found.append(float(np.linalg.norm(directions @ excess)))
    return Left(whole, tuple(like_itself), tuple(beside))
