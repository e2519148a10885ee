"""Smallest sum of slips that makes a measured strain, after SSLIP.

Vermeij, Peerlings, Geers and Hoefnagels, Acta Materialia 243 (2022) 118502: of all combinations of
slip systems that fit what is measured within its noise, the one of the smallest sum of |slip|.
There a displacement gradient is fitted and the lattice stands still; here the lattice may turn, so
that strains alone are fitted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq, linprog, nnls

from meshes.arrays import FloatArray

DRAWS = 200
"""Repetitions of a measurement behind an uncertainty: its relative error is 5 %."""
FLOOR = 0.95
"""Share of the repetitions of pure noise whose sum of slips is below the noise floor."""

_SEED = 20221  # of the repetitions: the same data, the same uncertainty
_WEIGHTS = (1e-9, 1e9)  # of the sum of slips, in units of the largest column
_ACTIVE = 1e-9  # slips below this share of the largest are rounding


@dataclass(frozen=True, eq=False)
class LeastSlip:
    """The smallest sum of slips of n systems, with its uncertainty by noise.

    Attributes:
        slip: of each system, with its sign [1], shape (n,).
        sigma: its standard deviation [1], shape (n,).
        total_sigma: standard deviation of the sum of |slip| [1].
        floor: sum of |slip| below which noise alone stays in 95 of 100 measurements [1].
        without: growth of the sum, as a share of it, where a system may not slip: 0 where another
            does as well, infinite where no other makes this strain; NaN of a system that does not
            slip; shape (n,).
    """

    slip: FloatArray
    sigma: FloatArray
    total_sigma: float
    floor: float
    without: FloatArray

    @property
    def total(self) -> float:
        """Sum of |slip| [1]."""
        return float(np.abs(self.slip).sum())


def least_slip(columns: FloatArray, strain: FloatArray, covariance: FloatArray) -> LeastSlip:
    """Return the smallest sum of slips that makes a strain within its noise, and how sure it is.

    Args:
        columns: strain of a unit slip of each system [1], shape (m, n).
        strain: what was measured [1], shape (m,).
        covariance: of its noise [1], shape (m, m), positive definite.
    """
    root = np.linalg.cholesky(covariance)
    whitened, measured = np.linalg.solve(root, columns), np.linalg.solve(root, strain)
    slip = systems_refitted(whitened, measured)
    noise = np.random.default_rng(_SEED).standard_normal((DRAWS, len(strain)))
    again = np.array([systems_refitted(whitened, measured + one) for one in noise])
    nothing = np.array([np.abs(systems_refitted(whitened, one)).sum() for one in noise])
    return LeastSlip(
        slip,
        again.std(axis=0),
        float(np.abs(again).sum(axis=1).std()),
        float(np.quantile(nothing, FLOOR)),
        growth_without(columns, slip),
    )


def systems_refitted(columns: FloatArray, strain: FloatArray) -> FloatArray:
    """Return the slips of least sum that make a strain of unit noise, freed of their bias.

    The squared distance may be the number m of the strains, its expectation. What this allows makes
    all slips too small: the systems that it finds are fitted once more without it.

    Args:
        columns: strain of a unit slip of each system over the noise, shape (m, n).
        strain: what was measured over its noise, shape (m,).

    Returns:
        Shape (n,).
    """
    found = smallest_slips(columns, strain, float(np.sqrt(len(strain))))
    if not found.any():
        return found
    active = np.flatnonzero(np.abs(found) > _ACTIVE * np.abs(found).max())
    slip = np.zeros(len(found))
    sign = np.sign(found[active])
    slip[active] = sign * nnls(sign * columns[:, active], strain)[0]
    return slip


def smallest_slips(columns: FloatArray, strain: FloatArray, distance: float) -> FloatArray:
    """Return the slips of least sum whose strain is no farther than a distance from another one.

    With slips of either sign as two that are not negative, least distance² + (weight · sum)² is a
    problem of nonnegative least squares; the weight is sought at which the distance is reached.
    Where no slips come so near, those that come nearest.

    Args:
        columns: strain of a unit slip of each system, shape (m, n).
        strain: shape (m,).
        distance: the distance, Euclidean.

    Returns:
        With their signs, shape (n,).
    """
    n = columns.shape[1]
    if strain @ strain <= distance**2:
        return np.zeros(n)
    both = np.hstack([columns, -columns])
    scale = float(np.linalg.norm(columns, axis=0).max())

    def chosen(log_weight: float) -> FloatArray:
        rows = np.vstack([both, np.full(2 * n, np.exp(log_weight) * scale)])
        return np.asarray(nnls(rows, np.append(strain, 0.0))[0])

    def excess(log_weight: float) -> float:
        left = strain - both @ chosen(log_weight)
        return float(np.sqrt(left @ left)) - distance

    least, most = np.log(_WEIGHTS)
    found = chosen(least if excess(least) >= 0.0 else brentq(excess, least, most))
    return found[:n] - found[n:]


def growth_without(columns: FloatArray, slip: FloatArray) -> FloatArray:
    """Growth of the sum of slips that makes the same strain where one system is barred.

    Args:
        columns: strain of a unit slip of each system, shape (m, n).
        slip: the slips, shape (n,).

    Returns:
        As `LeastSlip.without`, shape (n,).
    """
    total, strain = np.abs(slip).sum(), columns @ slip
    growth = np.full(slip.size, np.nan)
    for system in np.flatnonzero(slip):
        others = np.delete(columns, system, axis=1)
        both = np.hstack([others, -others])
        if both.size:
            # Of a sum of 1: what the solver calls equal is so to 10⁻⁷, which may be a whole strain.
            answer = linprog(np.ones(both.shape[1]), A_eq=both, b_eq=strain / total)
            growth[system] = answer.fun - 1.0 if answer.success else np.inf
        else:
            growth[system] = np.inf
    return growth
