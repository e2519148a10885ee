"""By how much two corrections differ, and one from itself on the way of a fit, in σ.

A fit that follows a correction taken where it began ends where that holds to first order. What it
lacks there goes with the square of the way, and so does what the next one changes.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from driver.identification.correction import Correction
from driver.identification.objective import Evaluation, Objective
from meshes.arrays import FloatArray


def whitened_difference(objective: Objective, one: Correction, other: Correction) -> FloatArray:
    """Change of the whitened prediction between two corrections, to first order, shape (n,)."""
    motion = np.asarray(one.motion) - np.asarray(other.motion)
    return objective.data.change(motion, np.asarray(one.load) - np.asarray(other.load))


def to_come(change: float, way: float, rest: float) -> float:
    """Return what taking a correction anew may change, by what that has changed the last time.

    Args:
        change: by which something has changed with the last one, which was taken where the fit
            before had ended, of either sign.
        way: from where the correction before was taken to there [σ], 0 for one without derivatives:
            all of the change may come again.
        rest: from there to where the fit ended with the last one [σ].
    """
    return abs(change) * ((rest / way) ** 2 if way else 1.0)


def changed_on_the_way(objective: Objective, begin: Mapping[str, float], at: Evaluation) -> float:
    """Norm of what the derivatives of a correction change it by, beside what is fitted [σ].

    0 for a correction without derivatives.

    Args:
        objective: with the correction.
        begin: every parameter where the way begins.
        at: the evaluation where it ends.
    """
    if objective.correction.derivatives is None:
        return 0.0
    before, after = (objective.correction.at(where) for where in (begin, at.values))
    change = whitened_difference(objective, after, before)
    fitted = at.jacobian.T @ np.linalg.solve(at.hessian, at.jacobian @ change)
    return float(np.linalg.norm(change - fitted))
