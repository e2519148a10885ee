"""What time steps of first order leave wrong, from a simulation with parts of those taken.

Backward Euler errs in proportion to the length of its steps: halved steps change a prediction by
half of its error. The steps are those that were taken, with those that had to be cut: a solver that
cuts some of them answers with another error than one that cuts none, and neither is the error of
the steps that were asked for.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from driver.forward.model import ForwardModel
from driver.forward.prediction import Prediction
from meshes.arrays import FloatArray
from solver_adapters.interface import Integration

FIRST_ORDER: Integration = "backward_euler"
"""The scheme whose error falls with the length of the steps."""


@dataclass(frozen=True, eq=False)
class StepError:
    """What the time steps of a prediction leave wrong.

    Attributes:
        motion: what is missing at the pixels [µm], shape (T, n_pix, 3).
        load: what is missing of the load [µN], shape (T,).
    """

    motion: FloatArray
    load: FloatArray

    def times(self, factor: float) -> StepError:
        """Return the error of steps that are so many times as long."""
        return StepError(factor * self.motion, factor * self.load)


def has_first_order(model: ForwardModel, prediction: Prediction) -> bool:
    """Whether the error of the steps of a prediction is estimated by parts of them.

    Steps that are refined to a stated accuracy have an estimate of their own.
    """
    of_model = model.integration == FIRST_ORDER and model.accuracy is None
    return of_model and prediction.response.ends.size > 0


def error_by_parts(prediction: Prediction, divided: Prediction, parts: int) -> StepError:
    """Return the error of the steps of a prediction, from one in equal parts of each.

    Args:
        prediction: the prediction.
        divided: that in parts.
        parts: of each step, two or more.
    """
    change = StepError(divided.motion - prediction.motion, divided.load - prediction.load)
    return change.times(parts / (parts - 1))


def in_parts_of(
    model: ForwardModel, prediction: Prediction, values: Mapping[str, float], parts: int
) -> ForwardModel:
    """Return a model that takes the steps of a prediction, each in so many equal parts.

    Args:
        model: a model of the same history.
        prediction: whose steps are taken, the ends of which it knows [s], shape (n,).
        values: the parameters that it was made with.
        parts: into which each of them is divided.
    """
    first, ends = model.clock(values)[0], prediction.response.ends
    begins = np.concatenate([[first], ends[:-1]])
    shares = np.arange(1, parts + 1) / parts
    divided = begins[:, None] + (ends - begins)[:, None] * shares
    return model.with_time_steps_of(divided.ravel(), values)


def parts_of(working: ForwardModel, finer: ForwardModel) -> int:
    """Equal parts of each working step by which finer steps are told.

    They are the steps an interval of the finer over those of the working model, rounded up.
    """
    return max(1, math.ceil(finer.steps_per_interval / working.steps_per_interval))
