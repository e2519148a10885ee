"""A variance component beside noise of unknown level: numbers y ~ N(0, k²I + s A).

With A = E diag(a) Eᵀ, z = Eᵀy, q = s/k² and S(q) = Σ z²/(1 + q a), noise of the likelihood
largest for q is k² = S/m, and with k integrated out (density 1/k) the likelihood is

    log L(q)/L(0) = −½ m log S(q)/S(0) − ½ Σ log(1 + q a).

The test most powerful at a stated q is by R = S(q)/S(0), whatever k is: under the null P(R < r)
is that of Σ (r − 1/(1 + q a)) χ²₁ > 0. It is made at a few q, and p multiplied by their number.
For y without the fitted parameters this is the restricted likelihood.
Sources: Rao and Kleffe, *Estimation of Variance Components*, North-Holland 1988; tests optimal at
a point, King, Econometric Theory 3 (1987) 169; the tail of a sum of χ² by the saddle point,
Kuonen, Biometrika 86 (1999) 929.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import brentq

from driver.common.distributions import normal_sf
from driver.diagnosis.statistics.score_test import SEEN_AT
from meshes.arrays import FloatArray

_RATIOS = np.geomspace(1e-4, 1e5, 700)  # q times the largest a at which L is tabulated
_POINTS = (3.0, 100.0)  # the same at which it is tested
_ALIKE = 1e-9  # relative spread of a without which a component is noise of another level
_MIDDLE = 1e-3  # standard deviations from the mean within which the tail is that of the mean


@dataclass(frozen=True, eq=False)
class Component:
    """A variance component beside noise of unknown level.

    Attributes:
        strength: a, shape (m,).
        power: z², shape (m,).
    """

    strength: FloatArray
    power: FloatArray

    @property
    def told_apart(self) -> bool:
        """Whether it differs from noise of another level."""
        return bool(np.ptp(self.strength) > _ALIKE * np.max(self.strength, initial=0.0))

    @property
    def p(self) -> float:
        """Probability of numbers as unlike, were s = 0, whatever the noise is."""
        return min(1.0, len(_POINTS) * self._least_p(self.power)) if self.told_apart else 1.0

    @property
    def level(self) -> float:
        """√s of the largest likelihood."""
        return float(self._levels[self._top]) if self.ratio else 0.0

    @property
    def noise(self) -> float:
        """K of the largest likelihood."""
        return float(np.sqrt((self._sums[self._top] if self.ratio else self.power.sum()) / self._m))

    @property
    def ratio(self) -> float:
        """2 log L/L(0) at the largest likelihood, at least 0."""
        return 2.0 * max(0.0, float(self._curve.max())) if self.told_apart else 0.0

    @property
    def visible(self) -> float:
        """√s of which the expected z² are as rare as 4.5 standard deviations."""
        if not self.told_apart:
            return np.inf
        rare = float(normal_sf(SEEN_AT))

        def too_common(log_q: float) -> float:
            return float(np.log(self._least_p(1.0 + np.exp(log_q) * self.strength) / rare))

        ends = np.log(self._ratios[[0, -1]])
        if too_common(ends[1]) > 0:
            return np.inf
        q = np.exp(float(brentq(too_common, *ends, xtol=1e-3)))
        return float(np.sqrt(q * self.power.mean()))

    @property
    def spread(self) -> float:
        """Standard deviation of √s under its likelihood, a half-normal prior as wide as it."""
        density = self._density(max(1.0, self.level))
        weight = np.exp(density - density.max())
        weight /= weight.sum()
        mean, square = float(weight @ self._levels), float(weight @ self._levels**2)
        # At each q the noise k is known to 1/√(2m) of itself, and √s with it.
        return float(np.sqrt(square - mean**2 + square / (2 * self._m)))

    @property
    def log_evidence(self) -> float:
        """Natural log of ∫ L/L(0) dp(√s), p the half-normal prior of one."""
        if not self.told_apart:
            return 0.0
        density = self._density(1.0)
        top = float(density.max())
        return top + float(np.log(np.exp(density - top).sum()))

    def _least_p(self, power: FloatArray) -> float:
        """Return the least p of the points."""
        tails = []
        for point in _POINTS:
            share = 1.0 / (1.0 + point * self.strength / self.strength.max())
            tails.append(tail(float(share @ power / power.sum()) - share, 0.0))
        return min(tails)

    @property
    def _m(self) -> int:
        return self.power.size

    @property
    def _top(self) -> int:
        return int(np.argmax(self._curve))

    @cached_property
    def _ratios(self) -> FloatArray:
        return np.asarray(_RATIOS / self.strength.max())

    @cached_property
    def _sums(self) -> FloatArray:
        return np.asarray((1.0 / (1.0 + np.outer(self._ratios, self.strength))) @ self.power)

    @cached_property
    def _levels(self) -> FloatArray:
        return np.asarray(np.sqrt(self._ratios * self._sums / self._m))

    @cached_property
    def _curve(self) -> FloatArray:
        grown = np.log1p(np.outer(self._ratios, self.strength)).sum(axis=1)
        return np.asarray(-0.5 * self._m * np.log(self._sums / self.power.sum()) - 0.5 * grown)

    def _density(self, width: float) -> FloatArray:
        prior = 0.5 * np.log(2.0 / np.pi) - np.log(width) - 0.5 * (self._levels / width) ** 2
        steps = np.gradient(self._levels)
        return np.asarray(self._curve + prior + np.log(steps))


def component(effect: FloatArray, numbers: FloatArray) -> Component:
    """Return the component of a covariance FᵀF in some numbers.

    Args:
        effect: F, shape (k, m).
        numbers: y, shape (m,).
    """
    strength, vector = np.linalg.eigh(effect.T @ effect)
    return Component(np.maximum(strength, 0.0), (vector.T @ numbers) ** 2)


def tail(weights: FloatArray, q: float) -> float:
    """P(Σ λ χ²₁ > q) by the saddle point.

    Args:
        weights: λ, of both signs or of one, shape (k,).
        q: a value that the sum can have.
    """
    scale = float(np.abs(weights).max())
    a, q = weights / scale, q / scale
    mean, variance = float(a.sum()), 2.0 * float(a @ a)
    if abs(q - mean) < _MIDDLE * np.sqrt(variance):
        return float(normal_sf(8.0 * float(np.sum(a**3)) / variance**1.5 / 6.0))

    def slope(t: float) -> float:
        return float(np.sum(a / (1.0 - 2.0 * t * a))) - q

    upper = 0.5 * (1.0 - 1e-12) / a.max() if a.max() > 0 else 1.0
    lower = 0.5 * (1.0 - 1e-12) / a.min() if a.min() < 0 else -1.0
    while a.min() >= 0 and slope(lower) > 0:
        lower *= 2.0
    while a.max() <= 0 and slope(upper) < 0:
        upper *= 2.0
    t = float(brentq(slope, lower, upper))
    log_mean = -0.5 * float(np.sum(np.log1p(-2.0 * t * a)))
    curvature = 2.0 * float(np.sum((a / (1.0 - 2.0 * t * a)) ** 2))
    w = np.sign(t) * np.sqrt(2.0 * (t * q - log_mean))
    v = t * np.sqrt(curvature)
    return float(normal_sf(w + np.log(v / w) / w))
