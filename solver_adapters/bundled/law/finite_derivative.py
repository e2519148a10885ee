"""Directional derivatives of a solved step at a Gauss point in finite strain.

Everything is linear in three things: the displacement gradient H, in which a change of Fp⁰⁻¹
counts as F·dFp⁰⁻¹·Fp⁰ and of which a spin only turns the stress; the change of A = Σ S Δp m⊗n that
constants and history make at fixed H; and dFp⁰⁻¹ itself where it enters outside the trial.
`response` prepares the matrices.
"""

from meshes.arrays import BoolArray, FloatArray, IntArray
from solver_adapters.bundled.law import tensors
from solver_adapters.bundled.law.law import P_A1
from solver_adapters.bundled.law.small_lu import solve
from solver_adapters.bundled.law.tensors import (
    NM,
    cofactor,
    cubic,
    determinant_of,
    over_modes,
    to_modes,
    to_tensors,
)
from solver_adapters.kernels import kernel

from . import NS, simd_rows
from .constant_derivatives import (
    advance_constants,
    constant_derivatives,
    constant_rows,
    elastic,
    factor_derivatives,
)
from .finite_strain import (
    CONDENSED,
    CONJUGATE_SCHMID,
    CONJUGATE_STRESS,
    D_A,
    D_FE,
    D_MODES,
    DILATION,
    DRIVING,
    FACTOR,
    FE,
    FES,
    FP0,
    FP1,
    FT,
    GAIN,
    ONE,
    P_BY_H,
    PIOLA,
    PULLED,
    SCALE,
    SCHMID,
    SCRATCH_MODES,
    SLIP_BY_H,
    SOFTENING,
    STATE_BY_A,
    STATE_BY_H,
    STRAIN,
    T_BY_H,
    TRIAL,
    TWO,
    UNDONE,
    UNIT,
    UNLOADED,
    drive,
    modes_along_gradient,
    resolve,
    stress_along_gradient,
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
    store,
    sum8,
    sum9,
)
from .slip_derivatives import (
    advance_states,
    history_derivatives,
    project_rows,
    weigh_rows,
)
from .workspace_layout import EXPLICIT, OTHER, SIGN

B_FP0 = B_SLIP_END  # derivative of Fp⁰⁻¹, 9
B_GRADIENT = B_FP0 + 9 * LANES  # of H, with what dFp⁰⁻¹ and a turn of the crystal count as, 9
B_SPIN = B_GRADIENT + 9 * LANES  # the part of it, times F⁻¹, that turns the point as it is, 9
B_PIOLA = B_SPIN + 9 * LANES  # of P, 9
B_STATE = B_PIOLA + 9 * LANES  # of Fp⁻¹ at unit determinant, 9
B_LOAD = B_STATE + 9 * LANES  # Σ S STEP m⊗n, 8
B_MODES = B_LOAD + NM * LANES  # change of A at fixed H, 8
B_FORCE = B_MODES + NM * LANES  # change of the modes of T, by it or by H, 8
B_SCRATCH = B_FORCE + NM * LANES  # 9
B_DILATION = B_SCRATCH + 9 * LANES  # change of ln det(Fp⁰⁻¹·(I − A))/3, 1
LANES_SIZE = B_DILATION + LANES


@kernel
def response(
    w: FloatArray,
    b: FloatArray,
    moving: IntArray,
    count: int,
    p: FloatArray,
    coupled: bool,
    by_slip: FloatArray,
    by_state: FloatArray,
) -> None:
    """How slips (9, NS) and Fp⁻¹ (9, 9) of the step in the workspace follow H, and the matrices.

    Slips of the moving systems alone, the first `count` of `moving`, are written.
    """
    _fixed_tensors(w)
    modes_along_gradient(w, p)
    stress_along_gradient(w, P_BY_H)
    over_modes(w, TWO, SOFTENING, D_MODES, 9)
    for k in range(NM):
        for j in range(9):
            b[B_FORCE + LANES * k + j] = w[T_BY_H + 9 * k + j] - w[TWO + 9 * k + j]
    clear(b, B_EXPLICIT, count, 9)
    driving = DRIVING if p[P_A1] != 0.0 else SCHMID
    for a in range(count):
        s = moving[a]
        sum8(b, B_EXPLICIT + LANES * a, B_FORCE, w, driving + s, NS, w[SIGN + s], 9)
    weigh_rows(w, b, coupled, moving, count, 9)
    for a in range(count):
        for j in range(9):
            w[SLIP_BY_H + 9 * a + j] = b[B_STEP + LANES * a + j]
            by_slip[j, moving[a]] = b[B_STEP + LANES * a + j]
    to_tensors(w, D_A, D_MODES, 9)
    _state_change(w, D_A, 9, STATE_BY_H)
    for j in range(9):
        for i in range(9):
            by_state[j, i] = w[STATE_BY_H + 9 * i + j]
    _state_change(w, UNIT, NM, STATE_BY_A)
    for i in range(NM * NM):
        w[CONDENSED + i] = 0.0
    for k in range(NM):
        w[CONDENSED + (NM + 1) * k] = 1.0
    solve(w, FACTOR, NM, CONDENSED, NM)


@kernel
def _fixed_tensors(w: FloatArray) -> None:
    """UNDONE, UNLOADED, PULLED, PIOLA, FP1, DILATION and SCALE."""
    _invert(w, UNDONE, FP0)
    _invert(w, UNLOADED, FT)
    tensors.left(w, PULLED, FES, False, GAIN, True, 1)
    tensors.left(w, PIOLA, PULLED, False, FP0, True, 1)
    tensors.left(w, FP1, FP0, False, GAIN, False, 1)
    determinant = determinant_of(w, FP1)
    cofactor(w, DILATION, FP1)
    for i in range(9):
        w[DILATION + i] /= 3.0 * determinant
    w[SCALE] = determinant ** (-1.0 / 3.0)


@kernel
def _invert(w: FloatArray, target: int, source: int) -> None:
    determinant = determinant_of(w, source)
    cofactor(w, ONE, source)
    for i in range(3):
        for j in range(3):
            w[target + 3 * i + j] = w[ONE + 3 * j + i] / determinant


@kernel
def _state_change(w: FloatArray, change: int, width: int, target: int) -> None:
    """Change of Fp⁻¹ at unit determinant by that of A along `width` directions."""
    tensors.left(w, TWO, FP0, False, change, False, width)
    for m in range(width):
        dilation = 0.0
        for i in range(9):
            dilation += w[DILATION + i] * w[TWO + width * i + m]
        for i in range(9):
            w[target + width * i + m] = w[SCALE] * (w[FP1 + i] * dilation - w[TWO + width * i + m])


@kernel
def _split_off_spin(b: FloatArray, w: FloatArray, width: int) -> None:
    """Take the spin SPIN·F out of the change of F at B_GRADIENT.

    A turn of the crystal is nearly all spin, which must not make slip: taken with the rest, its
    rounding would.
    """
    simd_rows.right(b, B_SCRATCH, B_GRADIENT, w, UNLOADED, False, width)
    for i in range(3):
        for j in range(3):
            t = B_SPIN + LANES * (3 * i + j)
            one, other = B_SCRATCH + LANES * (3 * i + j), B_SCRATCH + LANES * (3 * j + i)
            for m in range(width):
                b[t + m] = 0.5 * (b[one + m] - b[other + m])
    add(b, B_SCRATCH, B_SPIN, -1.0, 9, width)
    simd_rows.right(b, B_GRADIENT, B_SCRATCH, w, FT, False, width)


@kernel
def derivatives(
    w: FloatArray,
    b: FloatArray,
    moving: IntArray,
    count: int,
    point: int,
    frame: int,
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
    """As `small_derivative.derivatives`, in finite strain."""
    first, width = bounded(first), bounded(width)
    count = bounded(count)
    fetch(b, B_FP0, 9, dstate, first, width)
    simd_rows.left(b, B_SCRATCH, w, FT, B_FP0, False, width)
    simd_rows.right(b, B_GRADIENT, B_SCRATCH, w, UNDONE, False, width)
    for i in range(9):
        t = B_GRADIENT + LANES * i
        for m in range(width):
            b[t + m] += dH[i, first + m]
    for m in range(width):
        turned = turn[first + m]
        if turned > 0:
            for i in range(9):
                b[B_GRADIENT + LANES * i + m] += dframe[turned, frame, i]
    _split_off_spin(b, w, width)
    # Of P: dFp⁰⁻¹ outside the trial and the spin; constants, H and A are added.
    simd_rows.left(b, B_PIOLA, w, PULLED, B_FP0, True, width)
    simd_rows.right(b, B_SCRATCH, B_SPIN, w, PIOLA, False, width)
    add(b, B_PIOLA, B_SCRATCH, 1.0, 9, width)
    history_derivatives(w, b, p, coupled, moving, count, dstate, first, width)
    factor_derivatives(w, b, p, moving, count, point, skinned, dskin, first, width)
    constant_derivatives(w, b, moving, count, changes, dp, first, width)
    for m in range(width):
        k = first + m
        if changes[k] and elastic(dp, k):
            _elasticity(w, b, moving, count, m, p, dp[k])
    weigh_rows(w, b, coupled, moving, count, width)
    project_rows(w, b, SCHMID, B_LOAD, NM, moving, count, width)
    clear(b, B_MODES, 2 * NM, width)
    for i in range(NM):
        sum8(b, B_MODES + LANES * i, B_LOAD, w, CONDENSED + NM * i, 1, 1.0, width)
    for i in range(NM):
        sum8(b, B_FORCE + LANES * i, B_MODES, w, SOFTENING + NM * i, 1, -1.0, width)
    driving = DRIVING if p[P_A1] != 0.0 else SCHMID
    for a in range(count):
        s = moving[a]
        sum8(b, B_EXPLICIT + LANES * a, B_FORCE, w, driving + s, NS, w[SIGN + s], width)
    weigh_rows(w, b, coupled, moving, count, width)
    for a in range(count):
        sum9(b, B_STEP + LANES * a, B_GRADIENT, w, SLIP_BY_H + 9 * a, 1, width)
    advance_states(w, b, gains, moving, count, dstate, first, width)
    # Fp⁻¹ likewise: dFp⁰⁻¹ outside the trial at unit determinant, then H, then A
    simd_rows.right(b, B_SCRATCH, B_FP0, w, GAIN, False, width)
    clear(b, B_DILATION, 1, width)
    sum9(b, B_DILATION, B_SCRATCH, w, DILATION, 1, width)
    for i in range(9):
        scratch, state, fp1 = B_SCRATCH + LANES * i, B_STATE + LANES * i, w[FP1 + i]
        for m in range(width):
            b[state + m] = w[SCALE] * (b[scratch + m] - fp1 * b[B_DILATION + m])
    for i in range(9):
        sum9(b, B_PIOLA + LANES * i, B_GRADIENT, w, P_BY_H + 9 * i, 1, width)
        sum8(b, B_PIOLA + LANES * i, B_MODES, w, T_BY_H + i, 9, -1.0, width)
        sum9(b, B_STATE + LANES * i, B_GRADIENT, w, STATE_BY_H + 9 * i, 1, width)
        sum8(b, B_STATE + LANES * i, B_MODES, w, STATE_BY_A + NM * i, 1, 1.0, width)
    store(b, B_PIOLA, 9, dP, first, width)
    store(b, B_STATE, 9, dstate, first, width)
    for m in range(width):
        k = first + m
        if changes[k]:
            advance_constants(w, p, exponential, dp, moving, count, dstate, k)


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
    """As `small_derivative.constants`, in finite strain."""
    if asked[P_A1]:
        to_modes(w, SCRATCH_MODES, CONJUGATE_STRESS, 1)
        resolve(w, CONJUGATE_SCHMID, SCRATCH_MODES, OTHER)
    constant_rows(w, dt, p, skin, exponential, coupled, asked)


@kernel
def _elasticity(
    w: FloatArray,
    b: FloatArray,
    moving: IntArray,
    count: int,
    lane: int,
    p: FloatArray,
    dp: FloatArray,
) -> None:
    """Add what a change of the elastic constants makes at fixed slips to one lane."""
    # Change of Fe·S owed to the constants, its resolved shear stresses, its part of P.
    cubic(w, TWO, STRAIN, dp, 1)
    tensors.left(w, D_FE, FE, False, TWO, False, 1)
    tensors.left(w, TWO, TRIAL, True, D_FE, False, 1)
    to_modes(w, SCRATCH_MODES, TWO, 1)
    drive(w, p, SCRATCH_MODES, EXPLICIT)
    for a in range(count):
        s = moving[a]
        b[B_EXPLICIT + LANES * a + lane] += w[SIGN + s] * w[EXPLICIT + s]
    tensors.left(w, TWO, D_FE, False, GAIN, True, 1)
    tensors.left(w, D_FE, TWO, False, FP0, True, 1)
    for i in range(9):
        b[B_PIOLA + LANES * i + lane] += w[D_FE + i]
