"""Directional derivatives of a solved step at a Gauss point in small strain.

A direction changes the trial modes by V·dH + dV·H − dep⁰ and puts a load Σ S STEP P on the
condensed system; `response` prepares its inverse.
"""

from meshes.arrays import BoolArray, FloatArray, IntArray
from solver_adapters.bundled.law.law import P_A1, P_C11, P_C12, P_C44
from solver_adapters.bundled.law.small_lu import solve_five
from solver_adapters.kernels import kernel

from . import NS
from .constant_derivatives import (
    advance_constants,
    constant_derivatives,
    constant_rows,
    elastic,
    factor_derivatives,
)
from .simd_rows import (
    B_EXPLICIT,
    B_SLIP_END,
    B_STEP,
    LANES,
    add,
    bounded,
    clear,
    fetch,
    sum5,
    sum9,
)
from .slip_derivatives import (
    advance_states,
    history_derivatives,
    project_rows,
    weigh_rows,
)
from .small_strain import (
    CHANGE,
    CONJUGATE_SCHMID,
    DRIVING,
    ELASTIC,
    FACTOR,
    INVERSE,
    ROWS,
    SCHMID,
    SCRATCH_MODES,
    STRESS,
    VOLUME,
    add_stress,
    resolve,
    strain_modes,
)
from .workspace_layout import OTHER, SIGN

B_H = B_SLIP_END  # derivative of H, 9
B_TRIAL = B_H + 9 * LANES  # of e* and the trace mode, 6
B_STRESS = B_TRIAL + 6 * LANES  # of the stress modes: at fixed slips, then in all, 6
B_LOAD = B_STRESS + 6 * LANES  # Σ S STEP P, 5
B_CHANGE = B_LOAD + 5 * LANES  # change of the stress modes that the slips make, 5
LANES_SIZE = B_CHANGE + 5 * LANES


@kernel
def response(
    w: FloatArray,
    b: FloatArray,
    moving: IntArray,
    count: int,
    V: FloatArray,
    p: FloatArray,
    coupled: bool,
    by_slip: FloatArray,
    by_state: FloatArray,
) -> None:
    """How slips (9, NS) and kinematic state (9, 9) of the step in the workspace follow H.

    Slips of the moving systems alone, the first `count` of `moving`, are written.
    """
    for k in range(25):
        w[ROWS + k] = 0.0
    for k in range(5):
        w[ROWS + 6 * k] = 1.0
    solve_five(w, FACTOR, ROWS, 5)
    for i in range(5):
        for k in range(5):
            w[INVERSE + 5 * i + k] = w[ROWS + 5 * k + i]
    mu0, mu1 = p[P_C11] - p[P_C12], 2.0 * p[P_C44]
    for j in range(9):
        for k in range(5):
            w[SCRATCH_MODES + k] = V[k, j]
        _invert(w, SCRATCH_MODES, CHANGE)
        for k in range(5):
            by_state[j, k] = V[k, j] - w[CHANGE + k] / (mu0 if k < 2 else mu1)
            b[B_CHANGE + LANES * k + j] = w[CHANGE + k]
        for k in range(5, 9):
            by_state[j, k] = 0.0
    clear(b, B_EXPLICIT, count, 9)
    driving = DRIVING if p[P_A1] != 0.0 else SCHMID
    for a in range(count):
        s = moving[a]
        sum5(b, B_EXPLICIT + LANES * a, B_CHANGE, w, driving + s, NS, w[SIGN + s], 9)
    weigh_rows(w, b, coupled, moving, count, 9)
    for a in range(count):
        for j in range(9):
            by_slip[j, moving[a]] = b[B_STEP + LANES * a + j]


@kernel
def _invert(w: FloatArray, source: int, target: int) -> None:
    t0 = t1 = t2 = t3 = t4 = 0.0
    for k in range(5):
        x, r = w[source + k], INVERSE + 5 * k
        t0 += w[r] * x
        t1 += w[r + 1] * x
        t2 += w[r + 2] * x
        t3 += w[r + 3] * x
        t4 += w[r + 4] * x
    w[target], w[target + 1], w[target + 2] = t0, t1, t2
    w[target + 3], w[target + 4] = t3, t4


@kernel
def derivatives(
    w: FloatArray,
    b: FloatArray,
    moving: IntArray,
    count: int,
    point: int,
    H: FloatArray,
    frame: int,
    V: FloatArray,
    p: FloatArray,
    exponential: bool,
    coupled: bool,
    first: int,
    width: int,
    dH: FloatArray,
    turn: IntArray,
    dframe: FloatArray,
    dp: FloatArray,
    changes: BoolArray,
    skinned: IntArray,
    dskin: FloatArray,
    dstate: FloatArray,
    gains: FloatArray,
    dP: FloatArray,
) -> None:
    """Derive stress and state of the step in the workspace, `width` from `first` on.

    dstate is that at the start of the step and becomes that at its end, with H as dH has it.

    b: lanes of the directions; moving: the systems that move, the first `count`; point and frame:
    rows of dskin and dframe; changes: whether a direction changes a constant; turn: whether, and
    how, it turns the crystal; gains: of `slip_derivatives.slip_gains`. The others are those of
    `Points.derive` at this point.
    """
    first, width = bounded(first), bounded(width)
    mu0, mu1 = p[P_C11] - p[P_C12], 2.0 * p[P_C44]
    count = bounded(count)
    _trial_rows(w, b, H, frame, V, first, width, dH, turn, dframe)
    for k in range(5):
        mu, t, stress = mu0 if k < 2 else mu1, B_TRIAL + LANES * k, B_STRESS + LANES * k
        for m in range(width):
            b[stress + m] = mu * (b[t + m] - dstate[k, first + m])
    history_derivatives(w, b, p, coupled, moving, count, dstate, first, width)
    factor_derivatives(w, b, p, moving, count, point, skinned, dskin, first, width)
    constant_derivatives(w, b, moving, count, changes, dp, first, width)
    for m in range(width):
        k = first + m
        if changes[k] and elastic(dp, k):
            dmu0, dmu1 = dp[k, P_C11] - dp[k, P_C12], 2.0 * dp[k, P_C44]
            for i in range(5):
                b[B_STRESS + LANES * i + m] += (dmu0 if i < 2 else dmu1) * w[ELASTIC + i]
    driving = DRIVING if p[P_A1] != 0.0 else SCHMID
    for a in range(count):
        s = moving[a]
        sum5(b, B_EXPLICIT + LANES * a, B_STRESS, w, driving + s, NS, w[SIGN + s], width)
    weigh_rows(w, b, coupled, moving, count, width)
    project_rows(w, b, SCHMID, B_LOAD, 5, moving, count, width)
    clear(b, B_CHANGE, 5, width)
    for k in range(5):
        sum5(b, B_CHANGE + LANES * k, B_LOAD, w, INVERSE + k, 5, -1.0, width)
    for a in range(count):
        s = moving[a]
        sum5(b, B_EXPLICIT + LANES * a, B_CHANGE, w, driving + s, NS, w[SIGN + s], width)
    weigh_rows(w, b, coupled, moving, count, width)
    advance_states(w, b, gains, moving, count, dstate, first, width)
    add(b, B_STRESS, B_CHANGE, 1.0, 5, width)
    bulk = p[P_C11] + 2.0 * p[P_C12]
    for m in range(width):
        b[B_STRESS + 5 * LANES + m] = bulk * b[B_TRIAL + 5 * LANES + m]
    if count > 0:
        # (A point that does not slip keeps its plastic strain.)
        for k in range(5):
            mu, t, stress = mu0 if k < 2 else mu1, B_TRIAL + LANES * k, B_STRESS + LANES * k
            for m in range(width):
                dstate[k, first + m] = b[t + m] - b[stress + m] / mu
    for m in range(width):
        k = first + m
        if changes[k]:
            advance_constants(w, p, exponential, dp, moving, count, dstate, k)
            if elastic(dp, k):
                _elasticity_after_slip(w, b, count, m, p, dp, dstate, k)
    _stress_rows(w, b, frame, V, bulk, first, width, turn, dframe, dP)


@kernel
def _trial_rows(
    w: FloatArray,
    b: FloatArray,
    H: FloatArray,
    frame: int,
    V: FloatArray,
    first: int,
    width: int,
    dH: FloatArray,
    turn: IntArray,
    dframe: FloatArray,
) -> None:
    """Set B_TRIAL to V·dH + dV·H."""
    fetch(b, B_H, 9, dH, first, width)
    clear(b, B_TRIAL, 6, width)
    for k in range(6):
        sum9(b, B_TRIAL + LANES * k, B_H, V[k], 0, 1, width)
    for m in range(width):
        turned = turn[first + m]
        if turned > 0:
            strain_modes(w, SCRATCH_MODES, dframe[turned, frame], H)
            for k in range(6):
                b[B_TRIAL + LANES * k + m] += w[SCRATCH_MODES + k]


@kernel
def _stress_rows(
    w: FloatArray,
    b: FloatArray,
    frame: int,
    V: FloatArray,
    bulk: float,
    first: int,
    width: int,
    turn: IntArray,
    dframe: FloatArray,
    dP: FloatArray,
) -> None:
    """Set dP to the tensors of the modes at B_STRESS, and to what turns make of the stress."""
    first, width = bounded(first), bounded(width)
    for i in range(9):
        v0, v1, v2, v3, v4, v5 = V[0, i], V[1, i], V[2, i], V[3, i], V[4, i], V[5, i]
        for m in range(width):
            dP[i, first + m] = (
                v0 * b[B_STRESS + m]
                + v1 * b[B_STRESS + LANES + m]
                + v2 * b[B_STRESS + 2 * LANES + m]
                + v3 * b[B_STRESS + 3 * LANES + m]
                + v4 * b[B_STRESS + 4 * LANES + m]
                + v5 * b[B_STRESS + 5 * LANES + m]
            )
    for m in range(width):
        turned = turn[first + m]
        if turned > 0:
            for i in range(9):
                w[ROWS + i] = 0.0
            add_stress(w[ROWS : ROWS + 9], dframe[turned, frame], w, STRESS, bulk * w[VOLUME])
            for i in range(9):
                dP[i, first + m] += w[ROWS + i]


@kernel
def constants(
    w: FloatArray,
    dt: float,
    p: FloatArray,
    skin: float,
    exponential: bool,
    coupled: bool,
    asked: BoolArray,
) -> None:
    """Write the rows of the constants that are asked for, see `constant_rows`."""
    if asked[P_A1]:
        resolve(w, CONJUGATE_SCHMID, STRESS, OTHER)
    constant_rows(w, dt, p, skin, exponential, coupled, asked)


@kernel
def _elasticity_after_slip(
    w: FloatArray,
    b: FloatArray,
    count: int,
    lane: int,
    p: FloatArray,
    dp: FloatArray,
    dstate: FloatArray,
    column: int,
) -> None:
    """Write what a change of the elastic constants makes of the state and of the pressure."""
    dC11, dC12, dC44 = dp[column, P_C11], dp[column, P_C12], dp[column, P_C44]
    b[B_STRESS + 5 * LANES + lane] += (dC11 + 2.0 * dC12) * w[VOLUME]
    if count == 0:
        return
    mu0, mu1 = p[P_C11] - p[P_C12], 2.0 * p[P_C44]
    for k in range(5):
        mu, dmu = (mu0, dC11 - dC12) if k < 2 else (mu1, 2.0 * dC44)
        stress = b[B_STRESS + LANES * k + lane] - dmu * w[ELASTIC + k]
        dstate[k, column] = b[B_TRIAL + LANES * k + lane] - stress / mu
