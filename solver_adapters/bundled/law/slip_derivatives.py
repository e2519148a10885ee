"""Derivatives of a solved step at the level of the slip systems.

What all directions share is prepared once for a point. What motion and history make is computed
for many directions at once (`simd_rows`), over the systems that move; what constants make, for each
direction that changes one.
"""

from meshes.arrays import FloatArray, IntArray
from solver_adapters.bundled.law.back_strain import growth, recall_slope, share_left
from solver_adapters.bundled.law.fast_math import decay, fast_log
from solver_adapters.bundled.law.law import (
    FIRST_112,
    FIRST_123,
    P_ASYMMETRY,
    P_B,
    P_C,
    P_C2,
    P_D,
    P_D2,
    P_K,
    P_N,
    P_TAU110,
    P_TAU112,
    P_TAU123,
)
from solver_adapters.bundled.law.relaxation import rate_change
from solver_adapters.kernels import kernel

from . import NS
from .law_terms import (
    hardening_derivative,
    hardens,
    modulus_of,
    second_back_stress_derivative,
)
from .simd_rows import B_EXPLICIT, B_OVER, B_STEP, LANES, bounded, clear
from .slip import weigh_residual
from .state_layout import S_ACC, S_OVER, S_X, S_X2
from .workspace_layout import (
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
    LEFT2,
    OVER0,
    OVER_CHANGE,
    OVER_GAIN,
    RECALL,
    SENSE,
    SIGN,
    SLIP,
    UNHARDENED,
    VISCOUS,
    WEIGHT,
    WEIGHTS,
    X0,
    X20,
    XHAT,
)


@kernel
def prepare_derivatives(w: FloatArray, p: FloatArray, exponential: bool) -> None:
    """Write what derivatives of the step share: LEFT to UNHARDENED, and LEFT2."""
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
        w[LEFT2 + s] = share_left(p[P_D2] * g, exponential)
        falls = exponential and w[FALL + s] > 0.0
        # ln(Δp/Δt) = n ln(v⁰/K) + ln ρ(r; n); its derivative at fixed Δp gives −dr.
        v0 = w[OVER0 + s] if falls else 1.0
        gain = w[VISCOUS + s] / v0 * (1.0 - n / w[FALL_SLOPE + s]) if falls else 0.0
        w[OVER_GAIN + s] = gain


@kernel
def moving_systems(w: FloatArray, moving: IntArray) -> int:
    """List the systems that are not at rest; returns how many."""
    count = 0
    for s in range(NS):
        if w[WEIGHT + s] != 0.0:
            moving[count] = s
            count += 1
    return count


@kernel
def explicit_derivative(
    w: FloatArray,
    dt: float,
    p: FloatArray,
    skin: float,
    exponential: bool,
    coupled: bool,
    dp: FloatArray,
    dskin: float,
) -> None:
    """Add to EXPLICIT what the residual owes to a change of the constants at fixed Δp and τ.

    D_OVER is set to the part of it that the overstress makes.
    """
    for s in range(NS):
        w[D_OVER + s] = 0.0
    _constants_derivative(w, dt, p, skin, exponential, dp, dskin)
    if hardens(dp) or (hardens(p) and dp[P_B] != 0.0):
        hardening_derivative(w, p, coupled, dp)
    if w[HAS_SECOND] != 0.0 and (dp[P_C2] != 0.0 or dp[P_D2] != 0.0):
        second_back_stress_derivative(w, p, exponential, dp)


@kernel
def history_derivatives(
    w: FloatArray,
    b: FloatArray,
    p: FloatArray,
    coupled: bool,
    moving: IntArray,
    count: int,
    dstate: FloatArray,
    first: int,
    width: int,
) -> None:
    """Set the rows of B_EXPLICIT and B_OVER to what the moving systems owe to their history."""
    count, first, width = bounded(count), bounded(first), bounded(width)
    for a in range(count):
        s = bounded(moving[a])
        history, gain = w[HISTORY + s], w[OVER_GAIN + s]
        e, o = B_EXPLICIT + LANES * a, B_OVER + LANES * a
        for m in range(width):
            over = gain * dstate[S_OVER + s, first + m]
            b[o + m] = over
            b[e + m] = -history * dstate[S_X + s, first + m] - over
    if hardens(p):
        for a in range(count):
            s, e = bounded(moving[a]), B_EXPLICIT + LANES * a
            for r in range(NS):
                if r == s or coupled:
                    slope = modulus_of(w, p, s, r) * p[P_B] * w[UNHARDENED + r]
                    for m in range(width):
                        b[e + m] -= slope * dstate[S_ACC + r, first + m]
    if dstate.shape[0] > S_X2:
        for a in range(count):
            s, e = bounded(moving[a]), B_EXPLICIT + LANES * a
            slope = p[P_C2] * w[SIGN + s] * w[LEFT2 + s]
            for m in range(width):
                b[e + m] -= slope * dstate[S_X2 + s, first + m]


@kernel
def put_constants(w: FloatArray, b: FloatArray, moving: IntArray, count: int, lane: int) -> None:
    """Add EXPLICIT and D_OVER of one direction to its lane."""
    for a in range(count):
        s = moving[a]
        b[B_EXPLICIT + LANES * a + lane] += w[EXPLICIT + s]
        b[B_OVER + LANES * a + lane] += w[D_OVER + s]


@kernel
def weigh_rows(
    w: FloatArray, b: FloatArray, coupled: bool, moving: IntArray, count: int, width: int
) -> None:
    """Set the rows of B_STEP to the weights times those of B_EXPLICIT."""
    count, width = bounded(count), bounded(width)
    if coupled:
        clear(b, B_STEP, count, width)
        for a in range(count):
            for other in range(count):
                factor = w[WEIGHTS + NS * moving[a] + moving[other]]
                t, e = B_STEP + LANES * a, B_EXPLICIT + LANES * other
                for m in range(width):
                    b[t + m] += factor * b[e + m]
        return
    for a in range(count):
        weight = w[WEIGHT + moving[a]]
        t, e = B_STEP + LANES * a, B_EXPLICIT + LANES * a
        for m in range(width):
            b[t + m] = weight * b[e + m]


@kernel
def project_rows(
    w: FloatArray, b: FloatArray, schmid: int, target: int, modes: int, moving: IntArray,
    count: int, width: int,
) -> None:  # fmt: skip
    """Set rows of modes to Σ S B_STEP P, with the modes (modes, NS) of the Schmid tensors."""
    target, count, width = bounded(target), bounded(count), bounded(width)
    clear(b, target, modes, width)
    for a in range(count):
        s, source = moving[a], B_STEP + LANES * a
        sign = w[SIGN + s]
        for k in range(modes):
            factor, t = sign * w[schmid + NS * k + s], target + LANES * k
            for m in range(width):
                b[t + m] += factor * b[source + m]


@kernel
def _of_family(p: FloatArray, s: int) -> float:
    """Return the entry of constants (17,) that is the τ0 of the family of a slip system."""
    found: float = p[P_TAU123]
    if s < FIRST_112:
        found = p[P_TAU110]
    elif s < FIRST_123:
        found = p[P_TAU112]
    return found


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
        d_tau0 = skin * _of_family(dp, s)
        d_tau0 -= sign * skin * dp[P_ASYMMETRY] * w[SENSE + s]
        d_tau0 += dskin * _of_family(p, s)
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
    """How the state of each system follows its slip (4, NS): x, S v, p, x2; 0 at rest."""
    second = w[HAS_SECOND] != 0.0
    for s in range(NS):
        moves = 1.0 if w[WEIGHT + s] != 0.0 else 0.0
        sign = moves * w[SIGN + s]
        gains[0, s] = sign * w[GROWTH + s]
        power = w[FALL_SLOPE + s] if w[FALL + s] > 0.0 else p[P_N]
        gains[1, s] = sign * w[VISCOUS + s] / (power * max(w[SLIP + s], 1e-30))
        gains[2, s] = moves
        start = w[SIGN + s] * w[X20 + s]
        slope = growth(w[LEFT2 + s], start, p[P_D2], exponential) if second else 0.0
        gains[3, s] = sign * slope


@kernel
def advance_states(
    w: FloatArray,
    b: FloatArray,
    gains: FloatArray,
    moving: IntArray,
    count: int,
    dstate: FloatArray,
    first: int,
    width: int,
) -> None:
    """Carry derivatives of the state over the step, from the rows of B_STEP.

    Of a system at rest nothing changes but an overstress that it had. What constants change at
    fixed slips is left to `advance_constants`. The number of rows of dstate says what of the state
    is wanted, see `Points.n_derived`.
    """
    count, first, width = bounded(count), bounded(first), bounded(width)
    for a in range(count):
        s = bounded(moving[a])
        x, over = S_X + s, S_OVER + s
        t, o = B_STEP + LANES * a, B_OVER + LANES * a
        left, sign, grows, speeds = w[LEFT + s], w[SIGN + s], gains[0, s], gains[1, s]
        for m in range(width):
            dstate[x, first + m] = left * dstate[x, first + m] + grows * b[t + m]
        for m in range(width):
            dstate[over, first + m] = sign * b[o + m] + speeds * b[t + m]
        if dstate.shape[0] > S_ACC:
            row = S_ACC + s
            for m in range(width):
                dstate[row, first + m] += b[t + m]
        if dstate.shape[0] > S_X2:
            row, left, grows = S_X2 + s, w[LEFT2 + s], gains[3, s]
            for m in range(width):
                dstate[row, first + m] = left * dstate[row, first + m] + grows * b[t + m]
    for s in range(NS):
        if w[WEIGHT + s] == 0.0 and w[OVER0 + s] != 0.0:
            for m in range(width):
                dstate[S_OVER + s, first + m] = 0.0


@kernel
def advance_constants(
    w: FloatArray,
    p: FloatArray,
    exponential: bool,
    dp: FloatArray,
    moving: IntArray,
    count: int,
    dstate: FloatArray,
    column: int,
) -> None:
    """Add what constants change of the back strains at fixed slips, along one direction."""
    if dp[P_D] != 0.0:
        for a in range(count):
            s = moving[a]
            dstate[S_X + s, column] += w[SIGN + s] * w[RECALL + s] * dp[P_D]
    if dp[P_D2] != 0.0 and dstate.shape[0] > S_X2:
        for a in range(count):
            s = moving[a]
            sign, left = w[SIGN + s], w[LEFT2 + s]
            recall = recall_slope(left, w[SLIP + s], p[P_D2], sign * w[X20 + s], exponential)
            dstate[S_X2 + s, column] += sign * recall * dp[P_D2]
