"""A variance component at its null: how likely the data are with a covariance V + s FᵀF.

The fitted parameters are projected out with their priors, so that the likelihood is the
restricted one. With r the whitened residual at the optimum, J the sensitivities, H = JJᵀ + prior,

    u = F (r − Jᵀ H⁻¹ (J r + prior·gap)),    A = F Fᵀ − F Jᵀ H⁻¹ J Fᵀ = E diag(a) Eᵀ,
    v = Eᵀu ~ N(0, a + s a²),    log L(s)/L(0) = ½ Σ (s v²/(1 + s a) − log(1 + s a)).

Its slope at s = 0, ½ (uᵀu − tr A), is the score: under the null uᵀu is Σ a χ²₁.
Sources: Rao and Kleffe, *Estimation of Variance Components*, North-Holland 1988; the tail of a sum
of χ² by the saddle point, Kuonen, Biometrika 86 (1999) 929.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.stats import norm

from driver.diagnosis.score import SEEN_AT
from driver.identification.fit import Evaluation

FloatArray = NDArray[np.float64]

_RANK = 1e-9
_SIZES = np.geomspace(1e-3, 10**2.5, 1200)  # √s at which the likelihood is tabulated
_MIDDLE = 1e-4  # relative distance from the mean within which the tail is a half


@dataclass(frozen=True, eq=False)
class Component:
    """A variance component in the directions that a fit leaves.

    Attributes:
        strength: a, shape (k,).
        power: v², shape (k,).
    """

    strength: FloatArray
    power: FloatArray

    @property
    def p(self) -> float:
        """Probability of a score as large, were s = 0."""
        return tail(self.strength, float(self.power.sum()))

    @property
    def visible(self) -> float:
        """√s whose mean score is 4.5 standard deviations of that under the null."""
        spread = float(np.sqrt(np.sum(self.strength**2)))
        return float(np.sqrt(SEEN_AT * np.sqrt(2.0) / spread)) if spread else np.inf

    @property
    def largest(self) -> float:
        """√s of the largest likelihood."""
        curve = self._curve
        return float(_SIZES[np.argmax(curve)]) if curve.max() > 0 else 0.0

    @property
    def ratio(self) -> float:
        """2 log L/L(0) at the largest likelihood."""
        return 2.0 * max(0.0, float(self._curve.max()))

    @property
    def spread(self) -> float:
        """Standard deviation of √s under its likelihood and a half-normal prior of one."""
        weight = np.exp(self._posterior - self._posterior.max())
        weight /= weight.sum()
        mean = float(weight @ _SIZES)
        return float(np.sqrt(weight @ (_SIZES - mean) ** 2))

    @property
    def log_evidence(self) -> float:
        """Natural log of ∫ L/L(0) dp(√s), p the half-normal prior of one."""
        top = float(self._posterior.max())
        return top + float(np.log(np.exp(self._posterior - top).sum()))

    @cached_property
    def _curve(self) -> FloatArray:
        s = _SIZES[:, None] ** 2
        share = s * self.power / (1.0 + s * self.strength)
        return np.asarray(0.5 * np.sum(share - np.log1p(s * self.strength), axis=1))

    @cached_property
    def _posterior(self) -> FloatArray:
        prior = 0.5 * np.log(2.0 / np.pi) - 0.5 * _SIZES**2
        return np.asarray(self._curve + prior + np.log(np.gradient(_SIZES)))


def component(effect: FloatArray, fitted: Evaluation) -> Component:
    """The component of a covariance FᵀF at a fit.

    Args:
        effect: F, whitened as the residual, shape (k, n).
        fitted: the fit, under V.
    """
    J, H = fitted.jacobian, fitted.hessian
    coupling = np.linalg.solve(H, J @ effect.T)
    u = effect @ fitted.residual - coupling.T @ fitted.gradient
    A = effect @ effect.T - (effect @ J.T) @ coupling
    strength, vector = np.linalg.eigh(0.5 * (A + A.T))
    kept = strength > _RANK * float(np.sum(effect**2))
    return Component(strength[kept], (vector[:, kept].T @ u) ** 2)


def tail(strength: FloatArray, q: float) -> float:
    """P(Σ a χ²₁ > q) by the saddle point.

    Args:
        strength: a > 0, shape (k,).
        q: the sum that was found.
    """
    if not strength.size:
        return 1.0
    if abs(q / strength.sum() - 1.0) < _MIDDLE:
        return 0.5
    a, q = strength / strength.max(), q / float(strength.max())

    def slope(t: float) -> float:
        return float(np.sum(a / (1.0 - 2.0 * t * a))) - q

    below = -1.0
    while slope(below) > 0:
        below *= 2.0
    t = float(brentq(slope, below, 0.5 * (1.0 - 1e-12)))
    log_mean = -0.5 * float(np.sum(np.log1p(-2.0 * t * a)))
    curvature = 2.0 * float(np.sum((a / (1.0 - 2.0 * t * a)) ** 2))
    w = np.sign(t) * np.sqrt(2.0 * (t * q - log_mean))
    v = t * np.sqrt(curvature)
    return float(norm.sf(w + np.log(v / w) / w))
