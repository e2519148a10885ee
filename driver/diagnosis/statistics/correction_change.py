"""By how much two corrections differ, and one from itself on the way of a fit, in σ."""

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


def changed_on_the_way(objective: Objective, begin: Mapping[str, float], at: Evaluation) -> float:
    """Norm of what a correction changes by with the parameters, beside what is fitted [σ].

    0 for one that counts as constant.

    Args:
        objective: with the correction.
        begin: every parameter where the way begins.
        at: the evaluation where it ends.
    """
    if objective.correction.is_constant:
        return 0.0
    before, after = (objective.correction.at(where) for where in (begin, at.values))
    change = whitened_difference(objective, after, before)
    fitted = at.jacobian.T @ np.linalg.solve(at.hessian, at.jacobian @ change)
    return float(np.linalg.norm(change - fitted))
