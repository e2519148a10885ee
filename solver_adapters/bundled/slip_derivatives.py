"""Derivatives of a solved step at the level of the slip systems.

What all directions share is prepared once for a point, so that a direction that leaves the
constants alone costs two products for each system.
"""

import numpy as np
from numpy.typing import NDArray

from solver_adapters.bundled.back_strain import growth, recall_slope, share_left
from solver_adapters.bundled.compilation import kernel
from solver_adapters.bundled.elementary import decay, fast_log
from solver_adapters.bundled.law import (
    FIRST_112,
    NS,
    P_ASYMMETRY,
    P_B,
    P_C,
    P_D,
    P_D2,
    P_K,
    P_N,
    P_TAU110,
    P_TAU112,
    S_ACC,
    S_OVER,
    S_X,
    S_X2,
)
from solver_adapters.bundled.law_terms import (
    hardening_derivative,
    hardens,
    second_back_stress_derivative,
)
from solver_adapters.bundled.relaxation import rate_change
from solver_adapters.bundled.slip import weigh_residual
from solver_adapters.bundled.slip_rows import (
    ACC0,
    D_OVER,
    D_TAU,
    EXPLICIT,
    FALL,
    FALL_SLOPE,
    GROWTH,
    HAS_SECOND,
    HISTORY,
    LEFT,
    OVER0,
    OVER_CHANGE,
    OVER_GAIN,
    RECALL,
    SENSE,
    SIGN,
    SLIP,
    STEP,
    UNHARDENED,
    VISCOUS,
    VISCOUS_SLOPE,
    WEIGHT,
    X0,
    X20,
    XHAT,
)

FloatArray = NDArray[np.float64]


@kernel
def prepare_derivatives(w: FloatArray, p: FloatArray, exponential: bool) -> None:
    """What the derivatives of the step in the workspace share: the rows LEFT to UNHARDENED."""
    c, d, n = p[P_C], p[P_D], p[P_N]
    for s in range(NS):
        g = w[SLIP + s]
        x0 = w[SIGN + s] * w[X0 + s]
        left = share_left(d * g, exponential)
        w[LEFT + s] = left
        w[RECALL + s] = recall_slope(left, g, d, x0, exponential)
        w[GROWTH + s] = growth(left, x0, d, exponential)
        w[HISTORY + s] = w[SIGN + s] * c * left
        w[UNHARDENED + s] = decay(p[P_B] * (w[ACC0 + s] + g))
        falls = exponential and w[FALL + s] > 0.0
        # ln(Δp/Δt) = n ln(v⁰/K) + ln ρ(r; n); its derivative at fixed Δp gives −dr.
        v0 = w[OVER0 + s] if falls else 1.0
        gain = w[VISCOUS + s] / v0 * (1.0 - n / w[FALL_SLOPE + s]) if falls else 0.0
        w[OVER_GAIN + s] = gain


@kernel
def explicit_derivative(
    w: FloatArray,
    dt: float,
    p: FloatArray,
    skin: float,
    exponential: bool,
    coupled: bool,
    constant: bool,
    dp: FloatArray,
    dskin: float,
    dstate: FloatArray,
) -> None:
    """Add to EXPLICIT what the residual owes to parameters and history at fixed Δp and τ.

    constant: whether dp and dskin are null.
    """
    for s in range(NS):
        w[D_OVER + s] = w[OVER_GAIN + s] * dstate[S_OVER + s]
        w[EXPLICIT + s] -= w[HISTORY + s] * dstate[S_X + s] + w[D_OVER + s]
    if not constant:
        _constants_derivative(w, dt, p, skin, exponential, dp, dskin)
    if hardens(p) or hardens(dp):
        hardening_derivative(w, p, coupled, dp, dstate)
    if w[HAS_SECOND] != 0.0:
        second_back_stress_derivative(w, p, exponential, dp, dstate)


@kernel
def _constants_derivative(
    w: FloatArray,
    dt: float,
    p: FloatArray,
    skin: float,
    exponential: bool,
    dp: FloatArray,
    dskin: float,
) -> None:
    """Add what EXPLICIT and D_OVER owe to K, n, c, d and the initial resistance."""
    K, n, c = p[P_K], p[P_N], p[P_C]
    for s in range(NS):
        sign = w[SIGN + s]
        d_tau0 = skin * (dp[P_TAU110] if s < FIRST_112 else dp[P_TAU112])
        d_tau0 -= sign * skin * dp[P_ASYMMETRY] * w[SENSE + s]
        d_tau0 += dskin * (p[P_TAU110] if s < FIRST_112 else p[P_TAU112])
        d_tau0 -= sign * dskin * p[P_ASYMMETRY] * w[SENSE + s]
        w[EXPLICIT + s] -= dp[P_C] * w[XHAT + s] + c * w[RECALL + s] * dp[P_D] + d_tau0
    if dp[P_K] == 0.0 and dp[P_N] == 0.0:
        return
    for s in range(NS):
        g = max(w[SLIP + s], 1e-30)
        change = dp[P_K] / K - dp[P_N] * fast_log(g / dt) / (n * n)
        w[OVER_CHANGE + s] = w[VISCOUS + s] * change
    if exponential:
        for s in range(NS):
            r = w[FALL + s]
            falls = r > 0.0
            v0 = w[SIGN + s] * w[OVER0 + s] if falls else 1.0
            e_a = decay((n - 1.0) * r)
            fall = n * dp[P_K] / K + dp[P_N] * (rate_change(r, e_a, n) - fast_log(v0 / K))
            change = w[VISCOUS + s] * fall / w[FALL_SLOPE + s]
            w[OVER_CHANGE + s] = change if falls else w[OVER_CHANGE + s]
    for s in range(NS):
        w[D_OVER + s] += w[OVER_CHANGE + s]
        w[EXPLICIT + s] -= w[OVER_CHANGE + s]


@kernel
def slip_change(w: FloatArray, coupled: bool) -> None:
    """STEP = change of the slips for the change D_TAU of the driving stresses."""
    for s in range(NS):
        w[EXPLICIT + s] = w[SIGN + s] * w[D_TAU + s]
    weigh_residual(w, EXPLICIT, coupled)


@kernel
def slip_gains(w: FloatArray, p: FloatArray, exponential: bool, gains: FloatArray) -> None:
    """How the state of each system follows its slip (4, 24): x, S v, p, x2."""
    for s in range(NS):
        sign = w[SIGN + s]
        gains[0, s] = sign * w[GROWTH + s]
        gains[1, s] = sign * w[VISCOUS_SLOPE + s] if w[WEIGHT + s] > 0.0 else 0.0
        gains[2, s] = 1.0
    if w[HAS_SECOND] != 0.0:
        for s in range(NS):
            left = share_left(p[P_D2] * w[SLIP + s], exponential)
            sign = w[SIGN + s]
            gains[3, s] = sign * growth(left, sign * w[X20 + s], p[P_D2], exponential)


@kernel
def total_slip_change(w: FloatArray, coupled: bool) -> None:
    """STEP = change of the slips for EXPLICIT and the change D_TAU of the driving stresses."""
    if coupled:
        for s in range(NS):
            w[EXPLICIT + s] += w[SIGN + s] * w[D_TAU + s]
        weigh_residual(w, EXPLICIT, coupled)
    else:
        for s in range(NS):
            w[STEP + s] += w[WEIGHT + s] * w[SIGN + s] * w[D_TAU + s]


@kernel
def finish_derivative(
    w: FloatArray,
    p: FloatArray,
    exponential: bool,
    dp: FloatArray,
    gains: FloatArray,
    dstate0: FloatArray,
    dstate1: FloatArray,
) -> None:
    """Derivatives of the state of the systems from STEP, the change of their slips.

    The lengths of dstate0 and dstate1 say what of the state is wanted, see `Points.n_derived`.
    """
    d_d = dp[P_D]
    for s in range(NS):
        sign = w[SIGN + s]
        slip = w[STEP + s]
        x = dstate0[S_X + s] * w[LEFT + s] + gains[0, s] * slip
        dstate1[S_X + s] = x + sign * w[RECALL + s] * d_d
        over = sign * w[D_OVER + s] if w[WEIGHT + s] > 0.0 else 0.0
        dstate1[S_OVER + s] = over + gains[1, s] * slip
    if dstate1.shape[0] > S_ACC:
        for s in range(NS):
            dstate1[S_ACC + s] = dstate0[S_ACC + s] + w[STEP + s]
    if dstate1.shape[0] > S_X2:
        d = p[P_D2]
        for s in range(NS):
            g = w[SLIP + s]
            left = share_left(d * g, exponential)
            sign = w[SIGN + s]
            recall = recall_slope(left, g, d, sign * w[X20 + s], exponential) * dp[P_D2]
            x2 = dstate0[S_X2 + s] * left + gains[3, s] * w[STEP + s]
            dstate1[S_X2 + s] = x2 + sign * recall
