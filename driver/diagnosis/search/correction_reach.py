"""How far a correction holds from the fit at which it was taken."""

from __future__ import annotations

import numpy as np

from driver.diagnosis.statistics.screening import whitened_difference
from driver.identification.correction import Correction
from driver.identification.fit import Fit
from driver.identification.objective import Objective

_FAR = 30.0
"""σ by which a prediction may move from where its correction was taken: a correction has changed
by a hundredth of what the prediction moved by, and the discretisation check lets 1 σ pass."""


def is_far(begin: Fit, end: Fit, objective: Objective) -> bool:
    """Whether the prediction of one fit is so far from another's that its correction does not hold.

    Args:
        begin: the fit at which the correction was taken.
        end: the other one.
        objective: by which the difference is whitened.
    """
    before, other = (
        Correction(f.best.prediction.motion, f.best.prediction.load) for f in (begin, end)
    )
    return float(np.linalg.norm(whitened_difference(objective, other, before))) >= _FAR
