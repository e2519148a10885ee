"""What an extension of the model gains: share of the excess explained, and log Bayes factor."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from driver.diagnosis.causes.causes import Cause
from driver.diagnosis.causes.noise_causes import COVARIANCE
from driver.diagnosis.statistics.bayes_factor import log_bayes_factor
from driver.identification.objective import Evaluation, Objective
from meshes.arrays import FloatArray

_SCATTER = 3.0  # standard deviations of the misfit of noise


def share_explained(before: Evaluation, after: Evaluation) -> float:
    """Share of the misfit above its expectation that is gone, of 1.

    Loads and images count where they have an excess beyond the scatter of noise: a hundred
    thousand numbers of the images would hide that of a hundred loads. NaN where none has.
    """
    excess, scatter = _excess(before)
    real = excess > _SCATTER * scatter
    if not real.any():
        return float("nan")
    left = np.maximum(_excess(after)[0], 0.0)
    return 1.0 - float(left[real].sum() / excess[real].sum())


def share_described(before: Evaluation, after: Evaluation, left: float) -> float:
    """Share of the misfit that is no noise that is gone, of 1.

    Args:
        before: the baseline, fitted under the covariance of the extended fit.
        after: the extended fit.
        left: misfit that the tests of what is left tell from noise [σ²].
    """
    gone = float(before.residual @ before.residual - after.residual @ after.residual)
    return gone / (gone + left) if gone > 0 else 0.0


def is_excess(at: Evaluation) -> bool:
    """Whether loads or images have a misfit beyond the scatter of noise."""
    excess, scatter = _excess(at)
    return bool(np.any(excess > _SCATTER * scatter))


def log_evidence(
    before: Evaluation, after: Evaluation, objective: Objective, causes: Sequence[Cause]
) -> float:
    """Log Bayes factor of an extended model against its baseline.

    The prior of each added parameter is the one of its cause, stated before the data were seen,
    and not the one that was widened to the effect.

    Args:
        before: the baseline, fitted under the covariance of the extended fit.
        after: the extended fit.
        objective: of the extended fit.
        causes: the causes that were added; noises are in the covariance of both.
    """
    causes = [cause for cause in causes if cause not in COVARIANCE]
    if not causes:
        return 0.0
    companions = {name for cause in causes for name in cause.companions} - set(before.free)
    effects = [cause.parameters for cause in causes]
    rising = [name for cause in causes if cause.one_sided for name in cause.parameters]
    return log_bayes_factor(before, after, objective, effects, sorted(companions), rising)


def _excess(at: Evaluation) -> tuple[FloatArray, FloatArray]:
    """Misfit of loads and of images above that of noise, and the scatter of noise, shapes (2,)."""
    taken = np.linalg.solve(np.linalg.cholesky(at.hessian), at.jacobian)
    excess, scatter = np.zeros(2), np.zeros(2)
    for i, part in enumerate((slice(0, at.n_load), slice(at.n_load, None))):
        r = at.residual[part]
        excess[i] = r @ r - (r.size - np.sum(taken[:, part] ** 2))
        scatter[i] = np.sqrt(2.0 * r.size)
    return excess, scatter
