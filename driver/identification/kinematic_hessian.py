"""The kinematic Hessian of the images alone, as the paper shows it in figure 12a."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from driver.identification.objective import Evaluation, Objective
from meshes.arrays import FloatArray


def kinematic_hessian(
    objective: Objective, evaluation: Evaluation, names: Sequence[str]
) -> FloatArray:
    """[M]_IDIC = Σ_t S_tᵀ M S_t / (2γ_f²) over the whole history (equation 2.6).

    S is the derivative of the motion with respect to q = log p, so that a unit is a change of a
    parameter by its own size. The motion that the stage takes away in each image is projected out;
    loads, prior and what images share do not enter.

    Args:
        objective: model and data.
        evaluation: an evaluation of it with these parameters free, among others.
        names: of the parameters.

    Returns:
        Shape (k, k).
    """
    rows = [evaluation.free.index(name) for name in names]
    z = objective.data.image_sensitivity(evaluation.prediction.restrict(rows))
    sizes = np.array([evaluation.values[name] for name in names])
    flat = (objective.data.image.noise_factor * sizes[:, None, None] * z).reshape(len(names), -1)
    return np.asarray(0.5 * flat @ flat.T)
