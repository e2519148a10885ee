"""Importance sampling of a posterior from a Student t about its maximum.

The Laplace approximation is the Gaussian of the Hessian at the maximum. Draws come from a
multivariate t of that covariance, whose tails are heavier. Each is weighted by posterior over
density, the largest weights smoothed by a generalised Pareto distribution, whose shape k tells
whether the weights can be trusted (Vehtari, Simpson, Gelman, Yao and Gabry, Pareto smoothed
importance sampling, JMLR 25 (2024) 72).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import multivariate_t

from meshes.arrays import FloatArray

FREEDOM = 10.0
"""Degrees of freedom of the t: of tens of parameters more of a Gaussian's draws weigh alike."""

TRUSTED = 0.7
"""Largest shape k with which a few hundred draws answer (the paper's bound for large numbers)."""


@dataclass(frozen=True, eq=False)
class Proposals:
    """Draws of a distribution that is known.

    Attributes:
        theta: the draws, shape (n, k).
        log_density: of each, but for a constant, shape (n,).
    """

    theta: FloatArray
    log_density: FloatArray


def proposals(
    hessian: FloatArray, n: int, seed: int, middle: FloatArray | None = None
) -> Proposals:
    """Return draws of a t about the maximum.

    Args:
        hessian: of half the cost, H = JJᵀ + P, shape (k, k).
        n: number of draws.
        seed: of the draws.
        middle: where the maximum lies, shape (k,); 0 if left out.
    """
    shape = np.linalg.inv(hessian)
    t = multivariate_t(
        np.zeros(len(shape)) if middle is None else middle,
        0.5 * (shape + shape.T),
        df=FREEDOM,
        seed=seed,
    )
    theta = np.asarray(t.rvs(n)).reshape(n, len(shape))
    return Proposals(theta, np.asarray(t.logpdf(theta)).reshape(n))


@dataclass(frozen=True, eq=False)
class Weighted:
    """Draws with their weights.

    Attributes:
        weights: of each draw, their sum 1, shape (n,).
        shape: k of the Pareto distribution of the largest weights.
    """

    weights: FloatArray
    shape: float

    @property
    def effective(self) -> float:
        """How many draws of the posterior itself would tell as much (Kish)."""
        return float(1 / np.sum(self.weights**2))

    def mean(self, values: FloatArray) -> FloatArray:
        """Return the mean of values of the draws, (n, …) → (…)."""
        return np.asarray(np.tensordot(self.weights, values, 1))

    def deviation(self, values: FloatArray) -> FloatArray:
        """Return the standard deviation of values of the draws, (n, …) → (…)."""
        return np.asarray(np.sqrt(self.mean((values - self.mean(values)) ** 2)))

    def quantiles(self, values: FloatArray, shares: FloatArray) -> FloatArray:
        """Return quantiles of values of the draws, (n,) and (m,) → (m,), linear in between."""
        order = np.argsort(values)
        reached = np.cumsum(self.weights[order]) - 0.5 * self.weights[order]
        return np.asarray(np.interp(shares, reached, values[order]))


def weighted(costs: FloatArray, drawn: Proposals) -> Weighted:
    """Weigh draws by the posterior.

    Args:
        costs: ‖r‖² + prior of each draw, infinite where the posterior is zero, shape (n,).
        drawn: the draws.

    Raises:
        ImportError: arviz-stats is not installed.
    """
    import arviz_stats.base

    smoothing: Any = arviz_stats.base  # it has no types
    raw = -0.5 * costs - drawn.log_density
    inside = np.isfinite(raw)
    # It takes the logarithms with the other sign.
    smoothed, shape = smoothing.array_stats.psislw(-raw[inside])
    weights = np.zeros(len(costs))
    weights[inside] = np.exp(smoothed)
    return Weighted(weights / weights.sum(), float(shape))
