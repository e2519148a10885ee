"""How wrong the stress may be after one time step: what the scheme of the step left out.

Of each system that has slipped the parts of its driving stress that depend on the course of the
slip within the step are evaluated again by a better rule, and compared:

- the back stresses by their exact paths (no difference in the exponential scheme);
- the overstress where it falls by the exact relaxation (likewise);
- the overstress where it rises by the rate at the end that a rate linear in time since the last
  step would have, which bounds what the mean rate of the step hides after yield;
- after a reversal the slip of a system whose overstress v⁰ the unloading takes away at a steady
  rate: (v⁰/K)ⁿ over the time that takes, divided by n + 1.
"""

from __future__ import annotations

import numpy as np

from meshes.arrays import FloatArray
from solver_adapters.bundled.law.gauss_points import Points
from solver_adapters.bundled.law.law import P_C, P_C2, P_C44, P_D, P_D2, P_K, P_N, SLIP_AT_REST

_LEAST_POWER = 0.5  # of n − 1, below which the second tangent is none


def stress_error(
    points: Points, state0: FloatArray, slips: FloatArray, dH: FloatArray, dt: float
) -> FloatArray:
    """Error of the axial stress at each point [MPa], (n_points,).

    Args:
        points: the law.
        state0: state at the start of the step, (n_points, n_state).
        slips: slips of the step, (n_points, n_systems).
        dH: change of the displacement gradient in the step, (n_points, 9).
        dt: length of the step [s].
    """
    p = points.local[points.grain]
    K, n, c, d = (p[:, [index]] for index in (P_K, P_N, P_C, P_D))
    slip, sign = np.abs(slips), np.sign(slips)
    rows = points.layout
    over_start = state0[:, rows.over : rows.accumulated]
    moved = slip > SLIP_AT_REST
    over0 = np.maximum(sign * over_start, 0.0)
    mean = K * (np.where(moved, slip, dt) / dt) ** (1.0 / n)
    falls = moved & (mean < over0)
    rises = moved & ~falls
    error = np.zeros_like(slip)
    # The rate grows from that of the start to twice the mean less that: at most to its double.
    start = np.minimum(over0 / np.maximum(mean, 1e-300), 1.0) ** n
    error += np.where(rises, mean * ((2.0 - start) ** (1.0 / n) - 1.0), 0.0)
    if not points.exponential:
        error += c * _path_error(sign * state0[:, rows.x : rows.over], slip, d)
        if state0.shape[1] > rows.x2:
            second = _path_error(sign * state0[:, rows.x2 :], slip, p[:, [P_D2]])
            error += p[:, [P_C2]] * second
        error += np.where(falls, mean - _relaxed(mean, over0, n), 0.0)
    total = slip.sum(axis=1)
    share = np.einsum("ps,ps->p", slip, error) / np.maximum(total, SLIP_AT_REST)
    modulus = p[:, P_C44]
    unloading = modulus * np.linalg.norm(dH, axis=1)
    stops = np.where(moved, 0.0, abs(over_start))
    missed = dt * (stops / K) ** n * stops / ((n + 1.0) * (stops + unloading[:, None] + 1e-12))
    # Axial stress is about twice the resolved shear stress.
    return np.asarray(2.0 * (share + modulus * missed.sum(axis=1)))


def _path_error(start: FloatArray, slip: FloatArray, d: FloatArray) -> FloatArray:
    """Difference of the exact and the backward Euler back strain after a slip."""
    u = d * slip
    euler = (start + slip) / (1.0 + u)
    gained = np.where(u > 1e-8, -np.expm1(-u) / np.maximum(d, 1e-300), slip)
    return np.asarray(np.abs(start * np.exp(-u) + gained - euler))


def _relaxed(mean: FloatArray, over0: FloatArray, n: FloatArray) -> FloatArray:
    """Overstress at the end of a relaxation, from that of its mean rate.

    v⁰ e^(−r) of `relaxation.near_fall`; near n = 1, where the overstress decays as exp(−a) and no
    power is left, of its first tangent alone.
    """
    ratio = np.minimum(mean / np.maximum(over0, 1e-300), 1.0)
    power = np.maximum(n - 1.0, _LEAST_POWER)
    near, far = ratio**2, np.minimum((ratio**n / power) ** (1.0 / power), 1.0)
    end = np.where(n > 2.0, np.maximum(near, far), np.minimum(near, far))
    return np.asarray(over0 * np.where(n < 1.0 + _LEAST_POWER, near, end))
