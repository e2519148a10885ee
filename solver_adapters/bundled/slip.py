"""The 24 scalar equations of a Gauss point: evaluation, Newton update and derivative.

Everything of a point lives in one flat workspace with constant offsets, so that LLVM sees that
the rows do not overlap and vectorises the loops over systems. It does so where a loop does much:
a short body is unrolled first and then stays scalar, hence sums over systems in one loop each.

The terms of the general law stand in functions of their own, called where their parameter is not
null: at null the baseline is computed by the same operations as if they did not exist.
"""

import numpy as np
from numpy.typing import NDArray

from solver_adapters.bundled.compilation import kernel
from solver_adapters.bundled.dense import factor, solve
from solver_adapters.bundled.elementary import fast_exp, fast_log
from solver_adapters.bundled.law import (
    FIRST_112,
    NS,
    P_A1,
    P_ASYMMETRY,
    P_B,
    P_C,
    P_C2,
    P_C44,
    P_D,
    P_D2,
    P_K,
    P_LATENT,
    P_N,
    P_Q,
    P_TAU110,
    P_TAU112,
    S_ACC,
    S_OVER,
    S_X,
    S_X2,
    SLIP_AT_REST,
    SLIP_START,
)
from solver_adapters.bundled.relaxation import near_fall, rate_change, rate_ratio, rate_slope

FloatArray = NDArray[np.float64]

# Rows of the workspace, 24 numbers each but where said.
SIGN = 0 * NS  # S_s
SLIP = 1 * NS  # Δp_s
X0 = 2 * NS  # x_s at the start of the step
OVER0 = 3 * NS  # signed overstress at the start of the step
ACC0 = 4 * NS  # p_s at the start of the step
TAU0 = 5 * NS  # initial critical resolved shear stress
ASYMMETRY = 6 * NS  # what slip of positive sign adds to it
RISE = 7 * NS  # what hardening and the other terms of the general law add to it
SLOPE = 8 * NS  # ∂RISE/∂Δp of the same system
SHIFT = 9 * NS  # further back stress of a system at rest
TAU = 10 * NS  # resolved shear stress
WEIGHT = 11 * NS  # −1/(∂residual/∂Δp at fixed τ), 0 where at rest
RESIDUAL = 12 * NS
XHAT = 13 * NS  # S_s x_s at the end of the step
VISCOUS = 14 * NS  # overstress v at the end of the step
VISCOUS_SLOPE = 15 * NS  # ∂v/∂Δp
FALL = 16 * NS  # r = ln(v⁰/v) where the overstress relaxes, else 0
D_TAU = 17 * NS  # change of τ
LOAD = 18 * NS  # right-hand side of the condensed system
EXPLICIT = 19 * NS  # derivative of the residual at fixed Δp
SIGNED = 20 * NS  # S Δp
WEIGHTED = 21 * NS  # weights times one mode of the Schmid tensors; in `_fall` ln(Δp/SLIP0)
STEP = 22 * NS  # weights times a residual
X20 = 23 * NS  # second back strain at the start of the step
X2HAT = 24 * NS  # S_s times the second back strain at the end of the step
OTHER = 25 * NS  # shear stress on the conjugate plane (non-Schmid)
D_OVER = 26 * NS  # derivative of v at fixed Δp
SLIP0 = 27 * NS  # slip of the step at the overstress of its start
FALLEN = 28 * NS  # overstress at the end of a relaxation
FALL_SLOPE = 29 * NS  # −∂ ln Δp/∂r
LEFT = 30 * NS  # share of the back strain that the step leaves, for derivatives as what follows
RECALL = 31 * NS  # ∂(S x)/∂d
GROWTH = 32 * NS  # ∂(S x)/∂Δp
INTERACTION = 33 * NS  # h, 24 × 24
COUPLED = INTERACTION + NS * NS  # −∂residual/∂Δp with its off-diagonal terms, then its factors
WEIGHTS = COUPLED + NS * NS  # its inverse, null for systems at rest
SENSE = WEIGHTS + NS * NS  # +1 where positive slip is in the twinning sense, −1 against it
HAS_SECOND = SENSE + NS  # 1 where the state carries a second back strain
N_SLIP_ROWS = HAS_SECOND + 1

# Of numbers from 64 on: more than every system starting at once.
_EXPONENT_OF_64 = 1029


@kernel
def prepare_slip(w: FloatArray, interaction: FloatArray, sense: FloatArray) -> None:
    """Put interaction matrix (24, 24) and twinning senses (24) into a fresh workspace."""
    for s in range(NS):
        w[SENSE + s] = sense[s]
        for r in range(NS):
            w[INTERACTION + NS * s + r] = interaction[s, r]


@kernel
def load_point(
    w: FloatArray,
    state: FloatArray,
    p: FloatArray,
    skin: float,
    dt: float,
    exponential: bool,
    guess: FloatArray,
    solved: bool,
) -> None:
    """Put the state at the start of a step and the guess S Δp into the workspace.

    skin: factor on τ0 at this point; solved: whether the guess is the solution, to be kept.
    """
    for s in range(NS):
        w[X0 + s] = state[S_X + s]
        w[OVER0 + s] = state[S_OVER + s]
        w[ACC0 + s] = state[S_ACC + s]
        w[TAU0 + s] = skin * (p[P_TAU110] if s < FIRST_112 else p[P_TAU112])
        w[ASYMMETRY + s] = -skin * p[P_ASYMMETRY] * w[SENSE + s]
        w[RISE + s] = 0.0
        w[SLOPE + s] = 0.0
        w[SHIFT + s] = 0.0
        w[FALL + s] = 0.0
        g = guess[s]
        w[SLIP + s] = abs(g) if abs(g) > SLIP_AT_REST else 0.0
        w[SIGN + s] = 1.0 if g >= 0.0 else -1.0
    w[HAS_SECOND] = 0.0
    if state.shape[0] > S_X2:
        w[HAS_SECOND] = 1.0
        for s in range(NS):
            w[X20 + s] = state[S_X2 + s]
    if exponential:
        n = p[P_N]
        for s in range(NS):
            over = max(abs(w[OVER0 + s]), 1e-30)
            w[SLIP0 + s] = dt * fast_exp(n * fast_log(over / p[P_K]))
        _fall(w, n, solved)
        _relax(w, n, solved)
    for s in range(NS):
        w[SIGNED + s] = w[SIGN + s] * w[SLIP + s]


@kernel
def _fall(w: FloatArray, n: float, solved: bool) -> None:
    """Find the systems that begin to relax, from their slips; r becomes their unknown."""
    falling = 0.0
    for s in range(NS):
        falling += 1.0 if _begins_to_fall(w, s) else 0.0
    if falling == 0.0:
        return
    for s in range(NS):
        falls = _begins_to_fall(w, s)
        w[WEIGHTED + s] = fast_log(w[SLIP + s] / w[SLIP0 + s]) if falls else 0.0
        w[FALL + s] = near_fall(w[WEIGHTED + s], n) if falls else w[FALL + s]
    if solved:
        # Newton's method is monotone from there: four steps reach the last digits for n from
        # 1.5 to 100.
        for _ in range(4):
            for s in range(NS):
                r = w[FALL + s]
                e, e_a = fast_exp(-min(r, 600.0)), fast_exp(-min((n - 1.0) * r, 600.0))
                error = fast_log(rate_ratio(r, e, e_a, n)) - w[WEIGHTED + s]
                better = max(r + error / rate_slope(r, e, e_a, n), 0.0)
                w[FALL + s] = better if w[WEIGHTED + s] < 0.0 else r


@kernel
def _relax(w: FloatArray, n: float, solved: bool) -> None:
    """Slip, overstress at the end and slope of the systems that relax, from r."""
    for s in range(NS):
        r = w[FALL + s]
        falls = r > 0.0
        e, e_a = fast_exp(-min(r, 600.0)), fast_exp(-min((n - 1.0) * r, 600.0))
        w[FALLEN + s] = w[SIGN + s] * w[OVER0 + s] * e
        w[FALL_SLOPE + s] = rate_slope(r, e, e_a, n)
        slip = w[SLIP0 + s] * rate_ratio(r, e, e_a, n)
        w[SLIP + s] = slip if falls and not solved else w[SLIP + s]


@kernel
def _begins_to_fall(w: FloatArray, s: int) -> bool:
    slip = w[SLIP + s]
    onward = w[SIGN + s] * w[OVER0 + s] > 0.0
    return bool(onward and slip > SLIP_AT_REST and slip < w[SLIP0 + s] and w[FALL + s] == 0.0)


@kernel
def _path(u: float, exponential: bool) -> float:
    """Share of the recalled back strain that a step leaves: e^(−u) or 1/(1 + u), u = d Δp."""
    return fast_exp(-min(u, 600.0)) if exponential else 1.0 / (1.0 + u)


@kernel
def _gained(left: float, slip: float, d: float, exponential: bool) -> float:
    """Back strain that the slip of a step adds."""
    if exponential:
        u = d * slip
        # (1 − e^(−u))/u without cancellation
        small = 1.0 - u * (0.5 - u * (1.0 / 6.0 - u * (1.0 / 24.0 - u / 120.0)))
        return slip * (small if u < 1e-3 else (1.0 - left) / max(u, 1e-3))
    return slip * left


@kernel
def _recall_slope(left: float, slip: float, d: float, signed: float, exponential: bool) -> float:
    """∂/∂d of signed·left + gained, the back strain at the end of a step."""
    if exponential:
        u = d * slip
        # (u e^(−u) − 1 + e^(−u))/u² without cancellation
        small = -0.5 + u * (1 / 3.0 - u * (0.125 - u * (1 / 30.0 - u * (1 / 144.0 - u / 840.0))))
        v = max(u, 1e-2)
        share = small if u < 1e-2 else ((1.0 + v) * left - 1.0) / (v * v)
        return slip * (slip * share - signed * left)
    return -(signed + slip) * left * slip * left


@kernel
def _harden(w: FloatArray, p: FloatArray, coupled: bool) -> None:
    """RISE and SLOPE of isotropic hardening; the whole slope matrix goes to COUPLED."""
    if not coupled:
        for s in range(NS):
            rest = fast_exp(-min(p[P_B] * (w[ACC0 + s] + w[SLIP + s]), 600.0))
            w[RISE + s] = p[P_Q] * (1.0 - rest)
            w[SLOPE + s] = p[P_Q] * p[P_B] * rest
        return
    for s in range(NS):
        w[RISE + s] = 0.0
    for r in range(NS):
        rest = fast_exp(-min(p[P_B] * (w[ACC0 + r] + w[SLIP + r]), 600.0))
        rise, slope = p[P_Q] * (1.0 - rest), p[P_Q] * p[P_B] * rest
        for s in range(NS):
            h = w[INTERACTION + NS * s + r] + (p[P_LATENT] if s != r else 0.0)
            w[RISE + s] += h * rise
            w[COUPLED + NS * s + r] = h * slope
    for s in range(NS):
        w[SLOPE + s] = w[COUPLED + (NS + 1) * s]


@kernel
def _second_back_stress(w: FloatArray, p: FloatArray, exponential: bool) -> None:
    """Add c2 S x2 of moving systems to RISE and SLOPE; put that of systems at rest into SHIFT."""
    c, d = p[P_C2], p[P_D2]
    for s in range(NS):
        g = w[SLIP + s]
        moving = g > SLIP_AT_REST
        left = _path(d * g, exponential)
        start = w[SIGN + s] * w[X20 + s]
        end = start * left + _gained(left, g, d, exponential)
        growth = (1.0 - d * start) * (left if exponential else left * left)
        w[X2HAT + s] = end
        w[RISE + s] += c * end if moving else 0.0
        w[SLOPE + s] += c * growth if moving else 0.0
        w[SHIFT + s] = 0.0 if moving else c * w[X20 + s]


@kernel
def _non_schmid(w: FloatArray, p: FloatArray) -> None:
    """Resolved shear stress and RISE of {110} with the stress on the conjugate planes."""
    factor_110 = 1.0 + 0.5 * p[P_A1]
    for s in range(FIRST_112):
        w[TAU + s] *= factor_110
        w[RISE + s] -= p[P_A1] * w[OTHER + s]


@kernel
def _start_terms(w: FloatArray) -> None:
    for s in range(NS):
        w[RISE + s] = 0.0
        w[SLOPE + s] = 0.0
        w[SHIFT + s] = 0.0


@kernel
def evaluate_systems(
    w: FloatArray, dt: float, p: FloatArray, exponential: bool, coupled: bool
) -> float:
    """Residuals and weights from TAU and SLIP; systems above their threshold become active.

    Returns how far from solved the equations are: the sum of what each system would have to slip
    more if it were alone, and one for each system that has become active.
    """
    K = p[P_K]
    c = p[P_C]
    d = p[P_D]
    n_inverse = 1.0 / p[P_N]
    n = p[P_N]
    threshold = K * fast_exp(n_inverse * fast_log(10.0 * SLIP_AT_REST / dt))
    largest = fast_exp(n_inverse * fast_log(SLIP_START / dt))
    if p[P_Q] != 0.0 or w[HAS_SECOND] != 0.0 or p[P_A1] != 0.0:
        _start_terms(w)
        if p[P_Q] != 0.0:
            _harden(w, p, coupled)
        if w[HAS_SECOND] != 0.0:
            _second_back_stress(w, p, exponential)
        if p[P_A1] != 0.0:
            _non_schmid(w, p)
    started = 0.0
    for s in range(NS):
        g = w[SLIP + s]
        moving = g > SLIP_AT_REST
        drive = w[TAU + s] - c * w[X0 + s] - w[SHIFT + s]
        sign = w[SIGN + s] if moving else (1.0 if drive > 0.0 else -1.0)
        excess = abs(drive) - (w[TAU0 + s] + sign * w[ASYMMETRY + s] + w[RISE + s])
        active = moving or excess > threshold
        # (Δp/Δt)^(1/n) of a moving system; of a starting one the rate follows from its excess.
        start = min(max(excess / K, 1e-3), largest)
        base = g / dt if moving else start
        power = fast_exp((n_inverse if moving else n) * fast_log(base))
        v = power if moving else start
        slip = max(g if moving else dt * power, 1e-30)
        w[SIGN + s] = sign
        # WEIGHT marks the active systems until it is known.
        w[WEIGHT + s] = 1.0 if active else 0.0
        w[SLIP + s] = slip if active else 0.0
        w[VISCOUS + s] = K * v
        w[VISCOUS_SLOPE + s] = K * n_inverse * v / slip
        started += 1.0 if active and not moving else 0.0
    if exponential:
        for s in range(NS):
            falls = w[FALL + s] > 0.0
            slope = w[FALLEN + s] / (w[FALL_SLOPE + s] * max(w[SLIP + s], 1e-30))
            w[VISCOUS + s] = w[FALLEN + s] if falls else w[VISCOUS + s]
            w[VISCOUS_SLOPE + s] = slope if falls else w[VISCOUS_SLOPE + s]
    error = started
    for s in range(NS):
        sign = w[SIGN + s]
        active = w[WEIGHT + s] > 0.0
        x0 = sign * w[X0 + s]
        slip = max(w[SLIP + s], 1e-30)
        left = _path(d * slip, exponential)
        xhat = x0 * left + _gained(left, slip, d, exponential)
        growth = (1.0 - d * x0) * (left if exponential else left * left)
        stiffness = w[VISCOUS_SLOPE + s] + c * growth + w[SLOPE + s]
        weight = 1.0 / stiffness if active else 0.0
        resistance = w[TAU0 + s] + sign * w[ASYMMETRY + s] + w[RISE + s]
        residual = sign * (w[TAU + s] - w[SHIFT + s]) - c * xhat - resistance - w[VISCOUS + s]
        w[WEIGHT + s] = weight
        w[RESIDUAL + s] = residual if active else 0.0
        w[XHAT + s] = xhat if active else x0
        w[STEP + s] = weight * w[RESIDUAL + s]
        w[LOAD + s] = sign * w[STEP + s]
        error += abs(w[RESIDUAL + s]) / (stiffness + p[P_C44])
    if coupled:
        _couple(w)
        weigh_residual(w, RESIDUAL, coupled)
    return error


@kernel
def _couple(w: FloatArray) -> None:
    """WEIGHTS: the inverse of −∂residual/∂Δp at fixed τ over the active systems, else null."""
    for s in range(NS):
        moves = w[WEIGHT + s] > 0.0
        for r in range(NS):
            both = moves and w[WEIGHT + r] > 0.0
            if s == r:
                w[COUPLED + NS * s + r] = 1.0 / w[WEIGHT + s] if moves else 1.0
            elif not both:
                w[COUPLED + NS * s + r] = 0.0
            w[WEIGHTS + NS * s + r] = 1.0 if both and s == r else 0.0
    factor(w, COUPLED, NS)
    solve(w, COUPLED, NS, WEIGHTS, NS)


@kernel
def weigh_residual(w: FloatArray, source: int, coupled: bool) -> None:
    """STEP = weights times the row at source, LOAD = S STEP."""
    if coupled:
        for s in range(NS):
            total = 0.0
            for r in range(NS):
                total += w[WEIGHTS + NS * s + r] * w[source + r]
            w[STEP + s] = total
    else:
        for s in range(NS):
            w[STEP + s] = w[WEIGHT + s] * w[source + s]
    for s in range(NS):
        w[LOAD + s] = w[SIGN + s] * w[STEP + s]


@kernel
def weigh_mode(w: FloatArray, mode: int, coupled: bool) -> None:
    """WEIGHTED = S weights S times the row at mode."""
    if coupled:
        for s in range(NS):
            total = 0.0
            for r in range(NS):
                total += w[WEIGHTS + NS * s + r] * w[SIGN + r] * w[mode + r]
            w[WEIGHTED + s] = w[SIGN + s] * total
    else:
        for s in range(NS):
            w[WEIGHTED + s] = w[WEIGHT + s] * w[mode + s]


@kernel
def advance_slips(w: FloatArray, p: FloatArray, exponential: bool, coupled: bool) -> None:
    """Newton update of the slips from STEP and D_TAU.

    A decrease is taken in the variable Δp^(1/n), an increase in Δp: the residual is convex in
    the one and concave in the other, so neither direction overshoots. Where a system relaxes, the
    overstress v = v⁰ e^(−r) takes the step.
    """
    n = p[P_N]
    if coupled:
        for s in range(NS):
            w[EXPLICIT + s] = w[RESIDUAL + s] + w[SIGN + s] * w[D_TAU + s]
        weigh_residual(w, EXPLICIT, coupled)
    else:
        for s in range(NS):
            w[STEP + s] += w[WEIGHT + s] * w[SIGN + s] * w[D_TAU + s]
    for s in range(NS):
        g = max(w[SLIP + s], 1e-30)
        step = w[STEP + s]
        r = w[FALL + s]
        falls = exponential and r > 0.0
        lowers = step < 0.0
        power = w[FALL_SLOPE + s] if falls else n
        growth = fast_log(max(1.0 + step / (g * power), 0.1))
        new = g * fast_exp(n * growth) if lowers else w[SLIP + s] + step
        end = r - growth
        new = max(new, w[SLIP0 + s]) if falls and end <= 0.0 else new
        w[FALL + s] = max(end, 0.0) if falls and new > SLIP_AT_REST else 0.0
        w[SLIP + s] = new if new > SLIP_AT_REST else 0.0
    if exponential:
        _fall(w, n, False)
        _relax(w, n, False)
        for s in range(NS):
            rests = w[SLIP + s] <= SLIP_AT_REST
            w[FALL + s] = 0.0 if rests else w[FALL + s]
            w[SLIP + s] = 0.0 if rests else w[SLIP + s]
    for s in range(NS):
        w[SIGNED + s] = w[SIGN + s] * w[SLIP + s]


@kernel
def prepare_derivatives(w: FloatArray, p: FloatArray, exponential: bool) -> None:
    """What all derivatives of the step in the workspace share: LEFT, RECALL and GROWTH."""
    d = p[P_D]
    for s in range(NS):
        g = w[SLIP + s]
        x0 = w[SIGN + s] * w[X0 + s]
        left = _path(d * g, exponential)
        w[LEFT + s] = left
        w[RECALL + s] = _recall_slope(left, g, d, x0, exponential)
        w[GROWTH + s] = (1.0 - d * x0) * (left if exponential else left * left)


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
    dstate: FloatArray,
) -> None:
    """Add to EXPLICIT what the residual owes to parameters and history at fixed Δp and τ."""
    K = p[P_K]
    n = p[P_N]
    c = p[P_C]
    for s in range(NS):
        sign = w[SIGN + s]
        d_xhat = sign * dstate[S_X + s] * w[LEFT + s] + w[RECALL + s] * dp[P_D]
        d_tau0 = skin * (dp[P_TAU110] if s < FIRST_112 else dp[P_TAU112])
        d_tau0 -= sign * skin * dp[P_ASYMMETRY] * w[SENSE + s]
        d_tau0 += dskin * (p[P_TAU110] if s < FIRST_112 else p[P_TAU112])
        d_tau0 -= sign * dskin * p[P_ASYMMETRY] * w[SENSE + s]
        w[D_OVER + s] = dp[P_K] * w[VISCOUS + s] / K
        w[EXPLICIT + s] += -dp[P_C] * w[XHAT + s] - c * d_xhat - d_tau0
    if dp[P_N] != 0.0:
        for s in range(NS):
            g = max(w[SLIP + s], 1e-30)
            w[D_OVER + s] -= dp[P_N] * w[VISCOUS + s] * fast_log(g / dt) / (n * n)
    if exponential:
        for s in range(NS):
            r = w[FALL + s]
            falls = r > 0.0
            d_start = w[SIGN + s] * dstate[S_OVER + s]
            v0 = w[SIGN + s] * w[OVER0 + s] if falls else 1.0
            # ln(Δp/Δt) = n ln(v⁰/K) + ln ρ(r; n); its derivative at fixed Δp gives −dr.
            fall = n * (dp[P_K] / K - d_start / v0)
            if dp[P_N] != 0.0:
                e_a = fast_exp(-min((n - 1.0) * r, 600.0))
                fall += dp[P_N] * (rate_change(r, e_a, n) - fast_log(v0 / K))
            change = w[VISCOUS + s] * (d_start / v0 + fall / w[FALL_SLOPE + s])
            w[D_OVER + s] = change if falls else w[D_OVER + s]
    for s in range(NS):
        w[EXPLICIT + s] -= w[D_OVER + s]
    if p[P_Q] != 0.0 or dp[P_Q] != 0.0:
        _hardening_derivative(w, p, coupled, dp, dstate)
    if w[HAS_SECOND] != 0.0:
        _second_back_stress_derivative(w, p, exponential, dp, dstate)


@kernel
def _hardening_derivative(
    w: FloatArray, p: FloatArray, coupled: bool, dp: FloatArray, dstate: FloatArray
) -> None:
    for r in range(NS):
        total = w[ACC0 + r] + w[SLIP + r]
        rest = fast_exp(-min(p[P_B] * total, 600.0))
        change = dp[P_Q] * (1.0 - rest) + p[P_Q] * rest * (
            dp[P_B] * total + p[P_B] * (dstate[S_ACC + r] if p[P_Q] != 0.0 else 0.0)
        )
        # Without hardening the points count as uncoupled, but its derivative is coupled.
        if coupled or p[P_Q] == 0.0:
            for s in range(NS):
                h = w[INTERACTION + NS * s + r] + (p[P_LATENT] if s != r else 0.0)
                w[EXPLICIT + s] -= h * change
        else:
            w[EXPLICIT + r] -= change
        if dp[P_LATENT] != 0.0:
            rise = p[P_Q] * (1.0 - rest)
            for s in range(NS):
                w[EXPLICIT + s] -= dp[P_LATENT] * rise if s != r else 0.0


@kernel
def _second_back_stress_derivative(
    w: FloatArray, p: FloatArray, exponential: bool, dp: FloatArray, dstate: FloatArray
) -> None:
    c, d = p[P_C2], p[P_D2]
    for s in range(NS):
        g = w[SLIP + s]
        left = _path(d * g, exponential)
        sign = w[SIGN + s]
        start = sign * w[X20 + s]
        end = start * left + _gained(left, g, d, exponential)
        change = _recall_slope(left, g, d, start, exponential) * dp[P_D2]
        change += sign * dstate[S_X2 + s] * left
        w[EXPLICIT + s] -= dp[P_C2] * end + c * change


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
            left = _path(p[P_D2] * w[SLIP + s], exponential)
            growth = left if exponential else left * left
            sign = w[SIGN + s]
            gains[3, s] = sign * (1.0 - p[P_D2] * sign * w[X20 + s]) * growth


@kernel
def finish_derivative(
    w: FloatArray,
    p: FloatArray,
    exponential: bool,
    coupled: bool,
    dp: FloatArray,
    dstate0: FloatArray,
    dstate1: FloatArray,
) -> None:
    """Derivatives of the state of the systems from EXPLICIT and D_TAU.

    The lengths of dstate0 and dstate1 say what of the state is wanted, see `Points.n_derived`.
    """
    for s in range(NS):
        w[EXPLICIT + s] += w[SIGN + s] * w[D_TAU + s]
    weigh_residual(w, EXPLICIT, coupled)
    for s in range(NS):
        sign = w[SIGN + s]
        slip = w[STEP + s]
        gained = w[RECALL + s] * dp[P_D] + w[GROWTH + s] * slip
        dstate1[S_X + s] = dstate0[S_X + s] * w[LEFT + s] + sign * gained
        over = sign * (w[D_OVER + s] + w[VISCOUS_SLOPE + s] * slip)
        dstate1[S_OVER + s] = over if w[WEIGHT + s] > 0.0 else 0.0
    if dstate1.shape[0] > S_ACC:
        for s in range(NS):
            dstate1[S_ACC + s] = dstate0[S_ACC + s] + w[STEP + s]
    if dstate1.shape[0] > S_X2:
        d = p[P_D2]
        for s in range(NS):
            g = w[SLIP + s]
            left = _path(d * g, exponential)
            sign = w[SIGN + s]
            start = sign * w[X20 + s]
            growth = (1.0 - d * start) * (left if exponential else left * left)
            recall = _recall_slope(left, g, d, start, exponential) * dp[P_D2]
            dstate1[S_X2 + s] = dstate0[S_X2 + s] * left + sign * (recall + growth * w[STEP + s])


@kernel
def is_sound(w: FloatArray, error: float) -> bool:
    """Whether an error is a number and no system has slipped beyond all measure.

    The exponent is looked at, since compiled comparisons assume that there is no NaN.
    """
    total = error
    for s in range(NS):
        total += w[SLIP + s]
    exponent = (np.float64(total).view(np.int64) >> 52) & 0x7FF
    sound = bool(exponent < _EXPONENT_OF_64)
    return sound


@kernel
def store_slips(w: FloatArray, state: FloatArray, slips: FloatArray) -> None:
    """Write the state of the systems of a converged point, and S Δp."""
    for s in range(NS):
        active = w[WEIGHT + s] > 0.0
        state[S_X + s] = w[SIGN + s] * w[XHAT + s]
        state[S_OVER + s] = w[SIGN + s] * w[VISCOUS + s] if active else 0.0
        state[S_ACC + s] = w[ACC0 + s] + w[SLIP + s]
        slips[s] = w[SIGN + s] * w[SLIP + s]
    if w[HAS_SECOND] != 0.0:
        for s in range(NS):
            moved = w[SIGN + s] * w[X2HAT + s]
            state[S_X2 + s] = moved if w[WEIGHT + s] > 0.0 else w[X20 + s]
