"""The 24 scalar equations of a Gauss point: evaluation, Newton update and derivative.

Everything of a point lives in one flat workspace with constant offsets, so that LLVM sees that
the rows do not overlap and vectorises the loops over systems. It does so where a loop does much:
a short body is unrolled first and then stays scalar, hence sums over systems in one loop each.
"""

import numpy as np
from numpy.typing import NDArray

from solver_adapters.bundled.compilation import kernel
from solver_adapters.bundled.elementary import fast_exp, fast_log
from solver_adapters.bundled.law import (
    FIRST_112,
    NS,
    P_B,
    P_C,
    P_D,
    P_K,
    P_N,
    P_Q,
    P_TAU110,
    P_TAU112,
    S_ACC,
    S_X,
    SLIP_AT_REST,
    SLIP_START,
)

FloatArray = NDArray[np.float64]

# Rows of the workspace, 24 numbers each.
SIGN = 0 * NS  # S_s
SLIP = 1 * NS  # Δp_s
X0 = 2 * NS  # x_s at the start of the step
ACC0 = 3 * NS  # p_s at the start of the step
TAU0 = 4 * NS  # initial critical resolved shear stress
RISE = 5 * NS  # Q (1 − exp(−b p))
SLOPE = 6 * NS  # Q b exp(−b p)
TAU = 7 * NS  # resolved shear stress
WEIGHT = 8 * NS  # −1/(∂residual/∂Δp at fixed τ), 0 where at rest
RESIDUAL = 9 * NS
XHAT = 10 * NS  # S_s x_s at the end of the step
VISCOUS = 11 * NS  # K (Δp/Δt)^(1/n)
D_TAU = 12 * NS  # change of τ
LOAD = 13 * NS  # right-hand side of the condensed system
EXPLICIT = 14 * NS  # derivative of the residual at fixed Δp
SIGNED = 15 * NS  # S Δp
WEIGHTED = 16 * NS  # w times one mode of the Schmid tensors
N_SLIP_ROWS = 17 * NS


@kernel
def load_point(w: FloatArray, state: FloatArray, p: FloatArray, guess: FloatArray) -> None:
    """Put the state at the start of a step and the guess S Δp into the workspace."""
    for s in range(NS):
        w[X0 + s] = state[S_X + s]
        w[ACC0 + s] = state[S_ACC + s]
        w[TAU0 + s] = p[P_TAU110] if s < FIRST_112 else p[P_TAU112]
        w[RISE + s] = 0.0
        w[SLOPE + s] = 0.0
        g = guess[s]
        w[SLIP + s] = abs(g) if abs(g) > SLIP_AT_REST else 0.0
        w[SIGN + s] = 1.0 if g >= 0.0 else -1.0
        w[SIGNED + s] = w[SIGN + s] * w[SLIP + s]


@kernel
def evaluate_systems(w: FloatArray, dt: float, p: FloatArray, activate: bool) -> None:
    """Residuals and weights from TAU and SLIP; systems above their threshold become active.

    With ``activate`` false, systems at rest stay at rest (last evaluation of a converged point).
    """
    K = p[P_K]
    c = p[P_C]
    d = p[P_D]
    n_inverse = 1.0 / p[P_N]
    n = p[P_N]
    threshold = 1e300
    if activate:
        threshold = K * fast_exp(n_inverse * fast_log(10.0 * SLIP_AT_REST / dt))
    largest = fast_exp(n_inverse * fast_log(SLIP_START / dt))
    if p[P_Q] != 0.0:
        for s in range(NS):
            rest = fast_exp(-p[P_B] * (w[ACC0 + s] + w[SLIP + s]))
            w[RISE + s] = p[P_Q] * (1.0 - rest)
            w[SLOPE + s] = p[P_Q] * p[P_B] * rest
    for s in range(NS):
        tau = w[TAU + s]
        x0 = w[X0 + s]
        g = w[SLIP + s]
        resistance = w[TAU0 + s] + w[RISE + s]
        moving = g > SLIP_AT_REST
        drive = tau - c * x0
        excess = abs(drive) - resistance
        sign = w[SIGN + s] if moving else (1.0 if drive > 0.0 else -1.0)
        active = moving or excess > threshold
        # (Δp/Δt)^(1/n) of a moving system; of a starting one the rate follows from its excess.
        start = min(max(excess / K, 1e-3), largest)
        base = g / dt if moving else start
        power = fast_exp((n_inverse if moving else n) * fast_log(base))
        v = power if moving else start
        slip = max(g if moving else dt * power, 1e-30)
        q = 1.0 / (1.0 + d * slip)
        xhat = (sign * x0 + slip) * q
        stiffness = K * n_inverse * v / slip + c * (1.0 - d * sign * x0) * q * q + w[SLOPE + s]
        w[WEIGHT + s] = 1.0 / stiffness if active else 0.0
        w[RESIDUAL + s] = (sign * tau - c * xhat - resistance - K * v) if active else 0.0
        w[SIGN + s] = sign
        w[SLIP + s] = slip if active else 0.0
        w[XHAT + s] = xhat if active else sign * x0
        w[VISCOUS + s] = K * v
        w[LOAD + s] = sign * w[WEIGHT + s] * w[RESIDUAL + s]


@kernel
def advance_slips(w: FloatArray, p: FloatArray) -> float:
    """Newton update of the slips from D_TAU; returns the sum of their changes.

    A decrease is taken in the variable Δp^(1/n), an increase in Δp: the residual is convex in
    the one and concave in the other, so neither direction overshoots.
    """
    n = p[P_N]
    n_inverse = 1.0 / n
    change = 0.0
    for s in range(NS):
        g = w[SLIP + s]
        step = w[WEIGHT + s] * (w[RESIDUAL + s] + w[SIGN + s] * w[D_TAU + s])
        change += abs(max(step, -g))
        shrink = max(1.0 + step / max(g, 1e-30) * n_inverse, 0.1)
        lowered = g * fast_exp(n * fast_log(min(shrink, 1.0)))
        new = lowered if step < 0.0 else g + step
        new = new if new > SLIP_AT_REST else 0.0
        w[SLIP + s] = new
        w[SIGNED + s] = w[SIGN + s] * new
    return change


@kernel
def explicit_derivative(
    w: FloatArray, dt: float, p: FloatArray, dp: FloatArray, dstate: FloatArray
) -> None:
    """Add to EXPLICIT what the residual owes to parameters and history at fixed Δp and τ."""
    K = p[P_K]
    n = p[P_N]
    c = p[P_C]
    d = p[P_D]
    for s in range(NS):
        g = max(w[SLIP + s], 1e-30)
        q = 1.0 / (1.0 + d * g)
        xhat = w[XHAT + s]
        y = w[VISCOUS + s]
        d_xhat = w[SIGN + s] * dstate[S_X + s] * q - xhat * g * q * dp[P_D]
        d_tau0 = dp[P_TAU110] if s < FIRST_112 else dp[P_TAU112]
        w[EXPLICIT + s] += -dp[P_C] * xhat - c * d_xhat - d_tau0 - dp[P_K] * y / K
        w[EXPLICIT + s] -= w[SLOPE + s] * dstate[S_ACC + s]
    if dp[P_N] != 0.0:
        for s in range(NS):
            g = max(w[SLIP + s], 1e-30)
            w[EXPLICIT + s] += dp[P_N] * w[VISCOUS + s] * fast_log(g / dt) / (n * n)
    if dp[P_Q] != 0.0 or dp[P_B] != 0.0:
        for s in range(NS):
            total = w[ACC0 + s] + w[SLIP + s]
            rest = fast_exp(-p[P_B] * total)
            w[EXPLICIT + s] -= dp[P_Q] * (1.0 - rest) + dp[P_B] * p[P_Q] * total * rest


@kernel
def derivative_load(w: FloatArray) -> None:
    """Right-hand side of the condensed system for a derivative: LOAD = S w EXPLICIT."""
    for s in range(NS):
        w[LOAD + s] = w[SIGN + s] * w[WEIGHT + s] * w[EXPLICIT + s]


@kernel
def finish_derivative(
    w: FloatArray, p: FloatArray, dp: FloatArray, dstate0: FloatArray, dstate1: FloatArray
) -> None:
    """Derivatives of slips, back strains and accumulated slips from EXPLICIT and D_TAU."""
    d = p[P_D]
    for s in range(NS):
        g = w[SLIP + s]
        q = 1.0 / (1.0 + d * g)
        sign = w[SIGN + s]
        slip = w[WEIGHT + s] * (w[EXPLICIT + s] + sign * w[D_TAU + s])
        dx0 = dstate0[S_X + s]
        growth = (1.0 - d * sign * w[X0 + s]) * q * q
        dstate1[S_X + s] = dx0 * q - sign * w[XHAT + s] * g * q * dp[P_D] + sign * growth * slip
        dstate1[S_ACC + s] = dstate0[S_ACC + s] + slip


@kernel
def store_slips(w: FloatArray, state: FloatArray, slips: FloatArray) -> None:
    """Write back strains, accumulated slips and S Δp of a converged point."""
    for s in range(NS):
        state[S_X + s] = w[SIGN + s] * w[XHAT + s]
        state[S_ACC + s] = w[ACC0 + s] + w[SLIP + s]
        slips[s] = w[SIGN + s] * w[SLIP + s]
