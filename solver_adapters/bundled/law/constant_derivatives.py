"""How the residuals of the slip systems follow the constants of the law, at fixed slips and τ.

A row of the workspace for each constant serves all directions that change it.
"""

from meshes.arrays import BoolArray, FloatArray, IntArray
from solver_adapters.bundled.law.back_strain import recall_slope
from solver_adapters.bundled.law.fast_math import decay, fast_log
from solver_adapters.bundled.law.law import (
    FIRST_112,
    FIRST_123,
    N_LOCAL,
    P_A1,
    P_ASYMMETRY,
    P_B,
    P_C,
    P_C2,
    P_C11,
    P_C12,
    P_C44,
    P_D,
    P_D2,
    P_K,
    P_LATENT,
    P_N,
    P_Q,
    P_TAU110,
    P_TAU112,
    P_TAU123,
)
from solver_adapters.bundled.law.relaxation import rate_change
from solver_adapters.kernels import kernel

from . import NS
from .law_terms import (
    hardening_by_b,
    hardening_by_latent,
    hardening_by_q,
    non_schmid_by_a1,
    second_back_stress_by_c2,
    second_back_stress_by_d2,
)
from .simd_rows import B_EXPLICIT, B_FACTOR, B_OVER, LANES, bounded
from .state_layout import S_X, S_X2
from .workspace_layout import (
    BY_CONSTANT,
    FALL,
    FALL_SLOPE,
    HAS_SECOND,
    LEFT2,
    OVER0,
    RECALL,
    SENSE,
    SIGN,
    SLIP,
    VISCOUS,
    X20,
    XHAT,
)


@kernel
def constant_rows(
    w: FloatArray,
    dt: float,
    p: FloatArray,
    skin: float,
    exponential: bool,
    coupled: bool,
    asked: BoolArray,
) -> None:
    """Write the rows BY_CONSTANT, those at least of the constants that are asked for, (N_LOCAL,).

    Those of elasticity, the first three, act through the stress and have none.
    """
    _overstress_rows(w, dt, p, exponential, asked)
    _resistance_rows(w, skin, asked)
    by_c, by_d, c = BY_CONSTANT + NS * P_C, BY_CONSTANT + NS * P_D, p[P_C]
    for s in range(NS):
        w[by_c + s] = -w[XHAT + s]
        w[by_d + s] = -c * w[RECALL + s]
    if asked[P_Q]:
        hardening_by_q(w)
    if asked[P_B]:
        hardening_by_b(w, p, coupled)
    if asked[P_LATENT]:
        hardening_by_latent(w)
    if w[HAS_SECOND] != 0.0:
        if asked[P_C2]:
            second_back_stress_by_c2(w, p, exponential)
        if asked[P_D2]:
            second_back_stress_by_d2(w, p, exponential)
    if asked[P_A1]:
        non_schmid_by_a1(w, p)


@kernel
def _resistance_rows(w: FloatArray, skin: float, asked: BoolArray) -> None:
    if asked[P_TAU110] or asked[P_TAU112] or asked[P_TAU123]:
        by_110, by_112 = BY_CONSTANT + NS * P_TAU110, BY_CONSTANT + NS * P_TAU112
        by_123 = BY_CONSTANT + NS * P_TAU123
        for s in range(NS):
            w[by_110 + s] = -skin if s < FIRST_112 else 0.0
            w[by_112 + s] = -skin if FIRST_112 <= s < FIRST_123 else 0.0
            w[by_123 + s] = -skin if s >= FIRST_123 else 0.0
    if asked[P_ASYMMETRY]:
        by_asymmetry = BY_CONSTANT + NS * P_ASYMMETRY
        for s in range(NS):
            w[by_asymmetry + s] = skin * w[SIGN + s] * w[SENSE + s]


@kernel
def _overstress_rows(
    w: FloatArray, dt: float, p: FloatArray, exponential: bool, asked: BoolArray
) -> None:
    if not asked[P_K] and not asked[P_N]:
        return
    K, n = p[P_K], p[P_N]
    by_K, by_n = BY_CONSTANT + NS * P_K, BY_CONSTANT + NS * P_N
    for s in range(NS):
        g = max(w[SLIP + s], 1e-30)
        w[by_K + s] = -w[VISCOUS + s] / K
        w[by_n + s] = w[VISCOUS + s] * fast_log(g / dt) / (n * n)
    if not exponential:
        return
    for s in range(NS):
        r = w[FALL + s]
        falls = r > 0.0
        v0 = w[SIGN + s] * w[OVER0 + s] if falls else 1.0
        e_a = decay((n - 1.0) * r)
        slope = w[VISCOUS + s] / w[FALL_SLOPE + s]
        w[by_K + s] = -slope * n / K if falls else w[by_K + s]
        relaxed = -slope * (rate_change(r, e_a, n) - fast_log(v0 / K))
        w[by_n + s] = relaxed if falls else w[by_n + s]


@kernel
def constant_derivatives(
    w: FloatArray,
    b: FloatArray,
    moving: IntArray,
    count: int,
    changes: BoolArray,
    dp: FloatArray,
    first: int,
    width: int,
) -> None:
    """Add to the rows of B_EXPLICIT and B_OVER what constants make, `width` from `first` on.

    changes: whether a direction changes one, (k,); dp: their derivatives, (k, N_LOCAL).
    """
    for m in range(width):
        k = first + m
        if changes[k]:
            for j in range(P_K, N_LOCAL):
                if dp[k, j] != 0.0:
                    _add_constant(w, b, moving, count, j, dp[k, j], m)


@kernel
def _add_constant(
    w: FloatArray, b: FloatArray, moving: IntArray, count: int, j: int, change: float, lane: int
) -> None:
    by = BY_CONSTANT + NS * j
    for a in range(count):
        b[B_EXPLICIT + LANES * a + lane] += change * w[by + moving[a]]
    if j == P_K or j == P_N:
        for a in range(count):
            b[B_OVER + LANES * a + lane] -= change * w[by + moving[a]]


@kernel
def factor_derivatives(
    w: FloatArray,
    b: FloatArray,
    p: FloatArray,
    moving: IntArray,
    count: int,
    point: int,
    skinned: IntArray,
    dskin: FloatArray,
    first: int,
    width: int,
) -> None:
    """Add to the rows of B_EXPLICIT what changes of the factor on τ0 at this point make."""
    count, first, width = bounded(count), bounded(first), bounded(width)
    largest = 0.0
    for m in range(width):
        b[B_FACTOR + m] = dskin[skinned[first + m], point]
        largest = max(largest, abs(b[B_FACTOR + m]))
    if largest == 0.0:
        return
    for a in range(count):
        s = bounded(moving[a])
        tau0 = p[P_TAU110] if s < FIRST_112 else (p[P_TAU112] if s < FIRST_123 else p[P_TAU123])
        resistance = tau0 - w[SIGN + s] * p[P_ASYMMETRY] * w[SENSE + s]
        e = B_EXPLICIT + LANES * a
        for m in range(width):
            b[e + m] -= resistance * b[B_FACTOR + m]


@kernel
def elastic(dp: FloatArray, k: int) -> bool:
    """Whether direction k changes a constant of elasticity."""
    return bool(dp[k, P_C11] != 0.0 or dp[k, P_C12] != 0.0 or dp[k, P_C44] != 0.0)


@kernel
def advance_constants(
    w: FloatArray,
    p: FloatArray,
    exponential: bool,
    dp: FloatArray,
    moving: IntArray,
    count: int,
    dstate: FloatArray,
    k: int,
) -> None:
    """Add to dstate what constants change of the back strains at fixed slips, along direction k."""
    dd, dd2 = dp[k, P_D], dp[k, P_D2]
    if dd != 0.0:
        for a in range(count):
            s = moving[a]
            dstate[S_X + s, k] += w[SIGN + s] * w[RECALL + s] * dd
    if dd2 != 0.0 and dstate.shape[0] > S_X2:
        for a in range(count):
            s = moving[a]
            sign, left = w[SIGN + s], w[LEFT2 + s]
            recall = recall_slope(left, w[SLIP + s], p[P_D2], sign * w[X20 + s], exponential)
            dstate[S_X2 + s, k] += sign * recall * dd2
