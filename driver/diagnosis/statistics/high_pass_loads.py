"""The fast load residual: where slow model errors have no part, and noise has one variance.

The fast half of the cosine modes of the loads, fitted together with the images, leaves little
else than noise: y = V^(−1/2) B r has the covariance s² I, with B the modes, r the residual of
that fit, V what it leaves of unit noise, and s the noise over the stated one. In y any change of
the data is a known direction.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from driver.identification.cosine_modes import fast_modes
from driver.identification.objective import Evaluation
from meshes.arrays import FloatArray

FEWEST = 8  # degrees of freedom without which nothing is said of the noise
_RIDGE = 1e-12
UNTOUCHED = 0.9
"""Variance that a fit leaves of a direction it hardly touches. What it takes more of is where the
model moves fast loads, and an error of the model shows there as if it were noise."""
LEFT = 1e-3
"""Variance below which a fit has taken a direction."""
_WIDE = 10.0  # prior scales


@dataclass(frozen=True, eq=False)
class HighPassLoads:
    """The fast load residual, m numbers of one variance.

    Attributes:
        residual: y, shape (m,).
        modes: B, shape (T − T//2, T).
        images: sensitivities of the images, shape (k, n − T).
        through: B Jᵀ, shape (T − T//2, k).
        taken: what the fit takes of each mode by the gradient, shape (T − T//2, k).
        root: V^(−1/2), shape (m, T − T//2).
    """

    residual: FloatArray
    modes: FloatArray
    images: FloatArray
    through: FloatArray
    taken: FloatArray
    root: FloatArray

    def of(self, changes: FloatArray) -> FloatArray:
        """Return what whitened changes of the data make of y, (k, n) → (k, m)."""
        T = self.modes.shape[1]
        fast = self.modes @ changes[:, :T].T
        seen = self.through.T @ fast + self.images @ changes[:, T:].T
        return np.asarray((self.root @ (fast - self.taken @ seen)).T)


def high_pass_loads(fitted: Evaluation, left: float = UNTOUCHED) -> HighPassLoads:
    """Return the residual of a fit to images and fast loads alone: slow loads do not enter it.

    Args:
        fitted: the fit to all data.
        left: variance that it must have left of a direction.
    """
    T, J = fitted.n_load, fitted.jacobian
    modes = fast_modes(T)
    through = modes @ J[:, :T].T
    images = J[:, T:]
    H = through.T @ through + images @ images.T + np.diag(fitted.prior_weight)
    H += _RIDGE * np.trace(H) * np.eye(len(H))
    taken = np.asarray(np.linalg.solve(H, through.T).T, dtype=np.float64)
    variance, vector = np.linalg.eigh(np.eye(len(modes)) - taken @ through.T)
    kept = variance > left
    root = (vector[:, kept] / np.sqrt(variance[kept])).T
    fast = modes @ fitted.residual[:T]
    gradient = through.T @ fast + images @ fitted.residual[T:]
    residual = fast - taken @ (gradient + fitted.prior_weight * fitted.prior_gap)
    return HighPassLoads(root @ residual, modes, images, through, taken, root)


def freed(fitted: Evaluation, effect: FloatArray) -> Evaluation:
    """Return an evaluation with a cause freed, at its null, within a wide prior.

    Args:
        fitted: the evaluation.
        effect: whitened sensitivities of the cause per prior scale, shape (k, n).
    """
    more = np.zeros(len(effect))
    return replace(
        fitted,
        jacobian=np.concatenate([fitted.jacobian, effect]),
        prior_gap=np.concatenate([fitted.prior_gap, more]),
        prior_weight=np.concatenate([fitted.prior_weight, more + _WIDE**-2]),
    )
