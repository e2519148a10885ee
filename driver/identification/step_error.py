"""What time steps of first order leave wrong, from a simulation with the halves of those taken.

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
from numpy.typing import NDArray

from driver.model import ForwardModel
from driver.prediction import Prediction

FloatArray = NDArray[np.float64]

FIRST_ORDER = "backward_euler"


@dataclass(frozen=True, eq=False)
class StepError:
    """The error of the time steps of a prediction.

    Attributes:
        motion: what finer steps would add at the pixels, in all [µm], shape (T, n_pix, 3).
        load: the same of the load [µN], shape (T,).
    """

    motion: FloatArray
    load: FloatArray


def has_first_order(model: ForwardModel, prediction: Prediction) -> bool:
    """Whether the error of the steps of a prediction is estimated by halves of them."""
    of_model = model.integration == FIRST_ORDER and model.accuracy is None
    return of_model and prediction.response.ends.size > 0


def step_error(
    model: ForwardModel, prediction: Prediction, values: Mapping[str, float]
) -> StepError:
    """The error of the steps that the prediction of a model took.

    Raises:
        SolverError: the simulation in halved steps could not be finished.
    """
    halved = in_parts_of(model, prediction, values, 2).predict(values)
    return StepError(
        2.0 * (halved.motion - prediction.motion), 2.0 * (halved.load - prediction.load)
    )


def in_parts_of(
    model: ForwardModel, prediction: Prediction, values: Mapping[str, float], parts: int
) -> ForwardModel:
    """A model that takes the steps of a prediction, each in so many equal parts."""
    first = model.clock(values)[0]
    ends = prediction.response.ends
    begins = np.concatenate([[first], ends[:-1]])
    shares = np.arange(1, parts + 1) / parts
    divided = begins[:, None] + (ends - begins)[:, None] * shares
    return model.in_steps_of(divided.ravel(), values)


def parts_of(working: ForwardModel, finer: ForwardModel) -> int:
    """Parts of a working step that are steps of the finer simulation, at least as stated."""
    return max(1, math.ceil(finer.steps_per_interval / working.steps_per_interval))
