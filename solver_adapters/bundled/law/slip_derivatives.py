"""Derivatives of a solved step at the level of the slip systems.

What all directions share is prepared once for a point. What motion and history make is computed
for many directions at once (`simd_rows`), over the systems that move. What constants make stands in
`constant_derivatives`.
"""

from meshes.arrays import FloatArray, IntArray
from solver_adapters.bundled.law.back_strain import growth, recall_slope, share_left
from solver_adapters.bundled.law.fast_math import decay
from solver_adapters.bundled.law.law import (
    P_B,
    P_C,
    P_C2,
    P_D,
    P_D2,
    P_N,
)
from solver_adapters.kernels import kernel

from . import NS
from .law_terms import (
    hardens,
    modulus_of,
)
from .simd_rows import B_EXPLICIT, B_OVER, B_STEP, LANES, bounded, clear
from .state_layout import S_ACC, S_OVER, S_X, S_X2
from .workspace_layout import (
    ACC0,
    FALL,
    FALL_SLOPE,
    GROWTH,
    HAS_SECOND,
    HISTORY,
    LEFT,
    LEFT2,
    OVER0,
    OVER_GAIN,
    RECALL,
    SIGN,
    SLIP,
    UNHARDENED,
    VISCOUS,
    WEIGHT,
    WEIGHTS,
    X0,
    X20,
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
