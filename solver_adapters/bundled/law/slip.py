"""The scalar equations of a Gauss point, one a slip system: evaluation and Newton update.

The terms of the general law stand in `law_terms`.
"""

import numpy as np

from meshes.arrays import FloatArray
from solver_adapters.bundled.law.back_strain import gained, growth, share_left
from solver_adapters.bundled.law.fast_math import decay, fast_exp, fast_log
from solver_adapters.bundled.law.law import (
    FIRST_112,
    FIRST_123,
    P_A1,
    P_ASYMMETRY,
    P_C,
    P_C44,
    P_D,
    P_K,
    P_N,
    P_TAU110,
    P_TAU112,
    P_TAU123,
    SLIP_AT_REST,
    SLIP_START,
)
from solver_adapters.bundled.law.relaxation import near_fall, rate_ratio, rate_slope
from solver_adapters.bundled.law.small_lu import factor, solve
from solver_adapters.kernels import kernel

from . import NS
from .law_terms import harden, hardens, non_schmid, second_back_stress
from .state_layout import S_ACC, S_OVER, S_X, S_X2
from .workspace_layout import (
    ACC0,
    AHEAD,
    ASYMMETRY,
    COUPLED,
    D_TAU,
    EASED,
    EASED_RATE,
    EXCESS,
    FALL,
    FALL_SLOPE,
    FALLEN,
    HAS_SECOND,
    INTERACTION,
    LOAD,
    LOG_RATIO,
    OVER0,
    RESIDUAL,
    RISE,
    SENSE,
    SHIFT,
    SIGN,
    SIGNED,
    SLIP,
    SLIP0,
    SLOPE,
    STEP,
    TAU,
    TAU0,
    VISCOUS,
    WEIGHT,
    WEIGHTED,
    WEIGHTS,
    X0,
    X2HAT,
    X20,
    XHAT,
)

# Of numbers from 64 on: more than every system starting at once.
_EXPONENT_OF_64 = 1029


@kernel
def prepare_slip(w: FloatArray, interaction: FloatArray, sense: FloatArray) -> None:
    """Put interaction matrix (NS, NS) and twinning senses (NS) into a fresh workspace."""
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
    end: FloatArray,
) -> None:
    """Put the state at the start of a step and the guess S Δp into the workspace.

    skin: factor on τ0 at this point; solved: whether the guess is the solution, to be kept, and
    `end` the state at the end of the step, which is not read otherwise.
    """
    # What lies outside the workspace is read first: LLVM cannot know that it stays as it is. Rows
    # X0, OVER0 and ACC0 follow each other as they do in a state.
    asymmetry = -skin * p[P_ASYMMETRY]
    tau110, tau112, tau123 = skin * p[P_TAU110], skin * p[P_TAU112], skin * p[P_TAU123]
    for i in range(3 * NS):
        w[X0 + i] = state[S_X + i]
    for s in range(NS):
        w[SIGNED + s] = guess[s]
    for s in range(NS):
        w[TAU0 + s] = tau110 if s < FIRST_112 else (tau112 if s < FIRST_123 else tau123)
        w[ASYMMETRY + s] = asymmetry * w[SENSE + s]
        w[RISE + s] = 0.0
        w[SLOPE + s] = 0.0
        w[SHIFT + s] = 0.0
        w[FALL + s] = 0.0
        g = w[SIGNED + s]
        w[SLIP + s] = abs(g) if abs(g) > SLIP_AT_REST else 0.0
        w[SIGN + s] = 1.0 if g >= 0.0 else -1.0
    w[HAS_SECOND] = 0.0
    if state.shape[0] > S_X2:
        w[HAS_SECOND] = 1.0
        for s in range(NS):
            w[X20 + s] = state[S_X2 + s]
    if exponential:
        K, n = p[P_K], p[P_N]
        n_inverse = 1.0 / n
        for s in range(NS):
            start = fast_log(max(abs(w[OVER0 + s]), 1e-30) / K)
            rate = fast_log(max(w[SLIP + s], 1e-30) / dt)
            w[SLIP0 + s] = dt * fast_exp(n * start)
            w[VISCOUS + s] = K * fast_exp(n_inverse * rate)  # as `_overstress`, in one loop
        if solved:
            _have_fallen(w, n, end)
        else:
            _fall(w, n)
        _relax(w, n, solved)
    else:
        _overstress(w, p, dt)
    for s in range(NS):
        w[SIGNED + s] = w[SIGN + s] * w[SLIP + s]


@kernel
def _overstress(w: FloatArray, p: FloatArray, dt: float) -> None:
    """Overstress K (Δp/Δt)^(1/n) of the systems that slip."""
    K, n_inverse = p[P_K], 1.0 / p[P_N]
    for s in range(NS):
        w[VISCOUS + s] = K * fast_exp(n_inverse * fast_log(max(w[SLIP + s], 1e-30) / dt))


@kernel
def _fall(w: FloatArray, n: float) -> None:
    """Find the systems that begin to relax, from their slips; r becomes their unknown."""
    falling = 0.0
    for s in range(NS):
        falling += 1.0 if _begins_to_fall(w, s) else 0.0
    if falling == 0.0:
        return
    for s in range(NS):
        falls = _begins_to_fall(w, s)
        w[LOG_RATIO + s] = fast_log(w[SLIP + s] / w[SLIP0 + s]) if falls else 0.0
        w[FALL + s] = near_fall(w[LOG_RATIO + s], n) if falls else w[FALL + s]
    for s in range(NS):
        begun, r = w[LOG_RATIO + s] < 0.0, w[FALL + s]
        w[EASED + s] = decay(r) if begun else w[EASED + s]
        w[EASED_RATE + s] = decay((n - 1.0) * r) if begun else w[EASED_RATE + s]


@kernel
def _have_fallen(w: FloatArray, n: float, end: FloatArray) -> None:
    """Find r of the systems that have relaxed, from their overstress at the end of the step."""
    for s in range(NS):
        over0, over = w[OVER0 + s], end[S_OVER + s]
        # Rounding may leave the overstress of its start.
        falls = _begins_to_fall(w, s) and w[SIGN + s] * over < w[SIGN + s] * over0
        share = over / over0 if falls else 1.0
        r = -fast_log(share)
        w[FALL + s] = r
        w[EASED + s] = share
        w[EASED_RATE + s] = decay((n - 1.0) * r)


@kernel
def _relax(w: FloatArray, n: float, solved: bool) -> None:
    """Slip, overstress at the end and slope of the systems that relax, from r."""
    falling = 0.0
    for s in range(NS):
        falling += w[FALL + s]
    if falling == 0.0:
        return
    for s in range(NS):
        r, e, e_a = w[FALL + s], w[EASED + s], w[EASED_RATE + s]
        w[FALLEN + s] = w[SIGN + s] * w[OVER0 + s] * e
        w[FALL_SLOPE + s] = rate_slope(r, e, e_a, n)
        slip = w[SLIP0 + s] * rate_ratio(r, e, e_a, n)
        slip = slip if r > 0.0 and not solved else w[SLIP + s]
        rests = slip <= SLIP_AT_REST
        w[SLIP + s] = 0.0 if rests else slip
        w[FALL + s] = 0.0 if rests else r


@kernel
def _begins_to_fall(w: FloatArray, s: int) -> bool:
    slip = w[SLIP + s]
    onward = w[SIGN + s] * w[OVER0 + s] > 0.0
    return bool(onward and slip > SLIP_AT_REST and slip < w[SLIP0 + s] and w[FALL + s] == 0.0)


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
    c, d, n, C44 = p[P_C], p[P_D], p[P_N], p[P_C44]
    hard = hardens(p)
    if hard or w[HAS_SECOND] != 0.0 or p[P_A1] != 0.0:
        _start_terms(w)
        if hard:
            harden(w, p, coupled)
        if w[HAS_SECOND] != 0.0:
            second_back_stress(w, p, exponential)
        if p[P_A1] != 0.0:
            non_schmid(w, p)
    pushed = 0.0
    for s in range(NS):
        moving = w[SLIP + s] > SLIP_AT_REST
        drive = w[TAU + s] - c * w[X0 + s] - w[SHIFT + s]
        sign = w[SIGN + s] if moving else (1.0 if drive > 0.0 else -1.0)
        excess = abs(drive) - (w[TAU0 + s] + sign * w[ASYMMETRY + s] + w[RISE + s])
        w[SIGN + s] = sign
        w[EXCESS + s] = 0.0 if moving else excess
        pushed += 1.0 if w[EXCESS + s] > 0.0 else 0.0
    started = _start(w, p, dt) if pushed > 0.0 else 0.0
    error = started
    for s in range(NS):
        sign = w[SIGN + s]
        active = w[SLIP + s] > SLIP_AT_REST
        x0 = sign * w[X0 + s]
        slip = max(w[SLIP + s], 1e-30)
        left = share_left(d * slip, exponential)
        xhat = x0 * left + gained(left, slip, d, exponential)
        slope = c * growth(left, x0, d, exponential) + w[SLOPE + s]
        falls = w[FALL + s] > 0.0
        viscous = w[FALLEN + s] if falls else w[VISCOUS + s]
        # ∂v/∂Δp is v/power. One division gives the inverse of the stiffness, and of that and C44.
        power = (w[FALL_SLOPE + s] if falls else n) * slip
        stiffness = viscous + slope * power
        alone = stiffness + C44 * power
        inverse = power / (stiffness * alone)
        weight = alone * inverse if active else 0.0
        resistance = w[TAU0 + s] + sign * w[ASYMMETRY + s] + w[RISE + s]
        residual = sign * (w[TAU + s] - w[SHIFT + s]) - c * xhat - resistance - viscous
        w[VISCOUS + s] = viscous
        w[WEIGHT + s] = weight
        w[RESIDUAL + s] = residual if active else 0.0
        w[XHAT + s] = xhat if active else x0
        w[STEP + s] = weight * w[RESIDUAL + s]
        w[LOAD + s] = sign * w[STEP + s]
        error += abs(w[RESIDUAL + s]) * stiffness * inverse
    if coupled:
        _couple(w)
        weigh_residual(w, RESIDUAL, coupled)
    return error


@kernel
def _start(w: FloatArray, p: FloatArray, dt: float) -> float:
    """Let the systems at rest slip whose EXCESS over their resistance is enough; their number."""
    K, n = p[P_K], p[P_N]
    n_inverse = 1.0 / n
    threshold = K * fast_exp(n_inverse * fast_log(10.0 * SLIP_AT_REST / dt))
    largest = fast_exp(n_inverse * fast_log(SLIP_START / dt))
    started = 0.0
    for s in range(NS):
        excess = w[EXCESS + s]
        starts = excess > threshold
        rate = fast_exp(n * fast_log(min(max(excess / K, 1e-3), largest)))
        w[SLIP + s] = max(dt * rate, 1e-30) if starts else w[SLIP + s]
        started += 1.0 if starts else 0.0
    if started > 0.0:
        _overstress(w, p, dt)
    return started


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
def advance_slips(
    w: FloatArray, p: FloatArray, dt: float, exponential: bool, coupled: bool
) -> None:
    """Newton update of slips and overstresses from STEP and D_TAU.

    A decrease is taken in the variable Δp^(1/n), an increase in Δp: the residual is convex in
    the one and concave in the other, so neither direction overshoots. Where a system relaxes, the
    overstress v = v⁰ e^(−r) takes the step.
    """
    n = p[P_N]
    n_inverse = 1.0 / n
    if coupled:
        for s in range(NS):
            w[AHEAD + s] = w[RESIDUAL + s] + w[SIGN + s] * w[D_TAU + s]
        weigh_residual(w, AHEAD, coupled)
    else:
        for s in range(NS):
            w[STEP + s] += w[WEIGHT + s] * w[SIGN + s] * w[D_TAU + s]
    leaving = 0.0
    for s in range(NS):
        g = max(w[SLIP + s], 1e-30)
        step = w[STEP + s]
        r = w[FALL + s]
        falls = exponential and r > 0.0
        lowers = step < 0.0
        power = w[FALL_SLOPE + s] if falls else (n if lowers else 1.0)
        share = max(1.0 + step / (g * power), 0.1)
        change = fast_log(share)
        # What takes the step changes by `share`: v where a system relaxes, Δp^(1/n), or Δp.
        follows = fast_exp(((n - 1.0) if falls else (n if lowers else n_inverse)) * change)
        w[EASED + s] *= share if falls else 1.0
        w[EASED_RATE + s] *= follows if falls else 1.0
        w[VISCOUS + s] *= share if lowers else follows
        end = r - change
        leaves = falls and end <= 0.0
        lowered = g * follows * (share if falls else 1.0)
        new = lowered if lowers else w[SLIP + s] + step
        # What would come to rest by its own step does so, however much slower a relaxing one falls.
        stays = g if not lowers or lowered > SLIP_AT_REST else 0.0
        new = (max(new, w[SLIP0 + s]) if leaves else stays) if falls else new
        w[FALL + s] = max(end, 0.0) if falls and new > SLIP_AT_REST else 0.0
        w[SLIP + s] = new if new > SLIP_AT_REST else 0.0
        leaving += 1.0 if leaves else 0.0
    if leaving > 0.0:
        _overstress(w, p, dt)
    if exponential:
        _fall(w, n)
        _relax(w, n, False)
    for s in range(NS):
        w[SIGNED + s] = w[SIGN + s] * w[SLIP + s]


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
