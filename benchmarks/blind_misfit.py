"""What the fit of an experiment leaves of an effect, its noise taken out by the known truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.blind_ruler import identified, motion_at
from driver.diagnosis.causes import Cause
from driver.diagnosis.score import prior_scaled, score
from driver.virtual_course import Course


def left_of(path: Path, course: Course, cause: Cause) -> float:
    """Projected misfit of a cause in an experiment that has been identified [σ].

    It is the noncentrality of the score of the cause: of the residual of the fit the part that is
    not noise and looks like the cause. The nonlinear fit may take more of an effect than the ruler
    thinks, and what the finer mesh makes of it is missing in a correction without it.

    Args:
        path: the case.
        course: what happened.
        cause: the cause.
    """
    objective, values, free = identified(path)
    wide = objective.evaluate(values, (*free, *cause.parameters))
    here = objective.restrict(wide, free)
    known = objective.parameters
    effect = prior_scaled(wide.jacobian[len(free) :], cause.parameters, known)
    xy = objective.data.image.images.xy
    noise = objective.data.residual(motion_at(course, xy), course.load)[0]
    directions = score(cause, effect, here, 1).directions
    # They are perpendicular to all that the fit can take, priors aside.
    return float(np.linalg.norm(directions @ (here.residual - noise)))
