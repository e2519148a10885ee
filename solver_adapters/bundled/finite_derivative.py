"""Directional derivatives of a solved step at a Gauss point in finite strain.

Everything is linear in three things: the displacement gradient H, in which a change of Fp⁰⁻¹
counts as F·dFp⁰⁻¹·Fp⁰ and of which a spin only turns the stress; the change of A = Σ S Δp m⊗n that
constants and history make at fixed H; and dFp⁰⁻¹ itself where it enters outside the trial.
`response` prepares the matrices.
"""

import numpy as np
from numpy.typing import NDArray

from solver_adapters.bundled.compilation import kernel
from solver_adapters.bundled.finite_strain import (
    CONJUGATE_SCHMID,
    CONJUGATE_STRESS,
    D_A,
    D_FE,
    D_FP0,
    D_FP1,
    D_MODES,
    D_PIOLA,
    D_STATE,
    DILATION,
    FE,
    FES,
    FORCE,
    FP0,
    FP1,
    FT,
    GAIN,
    ONE,
    P_BY_A,
    P_BY_H,
    PIOLA,
    PULLED,
    SCALE,
    SCRATCH_MODES,
    SLIP_BY_H,
    SOFTENING,
    SPIN,
    STATE_BY_A,
    STATE_BY_H,
    STRAIN,
    TRIAL,
    TWO,
    UNDONE,
    UNLOADED,
    condensed_change,
    drive,
    modes_along_gradient,
    resolve,
    stress_change,
)
from solver_adapters.bundled.law import NS, P_A1, P_C11, P_C12, P_C44
from solver_adapters.bundled.law_terms import non_schmid_derivative
from solver_adapters.bundled.slip import weigh_residual
from solver_adapters.bundled.slip_derivatives import (
    explicit_derivative,
    finish_derivative,
    slip_change,
    total_slip_change,
)
from solver_adapters.bundled.slip_rows import D_TAU, EXPLICIT, OTHER, SIGN, STEP
from solver_adapters.bundled.tensors import (
    NM,
    add,
    cofactor,
    cubic,
    determinant_of,
    left,
    over_modes,
    right,
    to_modes,
)

FloatArray = NDArray[np.float64]


@kernel
def _normalised(w: FloatArray, target: int, source: int) -> None:
    """Change of Fp⁻¹ at unit determinant, for the change at source before it is scaled."""
    dilation = 0.0
    for i in range(9):
        dilation += w[DILATION + i] * w[source + i]
    for i in range(9):
        w[target + i] = w[SCALE] * (w[source + i] - w[FP1 + i] * dilation)


@kernel
def response(
    w: FloatArray, p: FloatArray, coupled: bool, by_slip: FloatArray, by_state: FloatArray
) -> None:
    """How slips (9, 24) and Fp⁻¹ (9, 9) of the step in the workspace follow H, and the matrices."""
    _fixed_tensors(w)
    modes_along_gradient(w, p)
    over_modes(w, TWO, SOFTENING, D_MODES, 9)
    for j in range(9):
        for k in range(NM):
            w[FORCE + k] = w[ONE + 9 * k + j] - w[TWO + 9 * k + j]
        drive(w, p, FORCE, D_TAU)
        slip_change(w, coupled)
        for s in range(NS):
            w[SLIP_BY_H + NS * j + s] = w[STEP + s]
            by_slip[j, s] = w[STEP + s]
    _stress_and_state(w, p, 9, P_BY_H, STATE_BY_H)
    for j in range(9):
        for i in range(9):
            by_state[j, i] = w[STATE_BY_H + 9 * j + i]
    for i in range(9 * NM):
        w[D_MODES + i] = 0.0
        w[D_FE + i] = 0.0
    for k in range(NM):
        w[D_MODES + (NM + 1) * k] = 1.0
    _stress_and_state(w, p, NM, P_BY_A, STATE_BY_A)


@kernel
def _fixed_tensors(w: FloatArray) -> None:
    """UNDONE, UNLOADED, PULLED, PIOLA, FP1, DILATION and SCALE."""
    _invert(w, UNDONE, FP0)
    _invert(w, UNLOADED, FT)
    left(w, PULLED, FES, False, GAIN, True, 1)
    left(w, PIOLA, PULLED, False, FP0, True, 1)
    left(w, FP1, FP0, False, GAIN, False, 1)
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
def _split_off_spin(w: FloatArray) -> None:
    """Take the spin SPIN·F out of the change of F at ONE.

    A turn of the crystal is nearly all spin, which must not make slip: taken with the rest, its
    rounding would.
    """
    right(w, TWO, ONE, False, UNLOADED, False, 1)
    for i in range(3):
        for j in range(3):
            w[SPIN + 3 * i + j] = 0.5 * (w[TWO + 3 * i + j] - w[TWO + 3 * j + i])
    for i in range(9):
        w[TWO + i] -= w[SPIN + i]
    left(w, ONE, TWO, False, FT, False, 1)


@kernel
def _stress_and_state(w: FloatArray, p: FloatArray, width: int, stress: int, state: int) -> None:
    """Changes of P and Fp⁻¹, direction first, that D_FE and D_MODES make along `width` of them."""
    stress_change(w, p, width)
    right(w, ONE, TWO, False, FP0, True, width)
    left(w, TWO, FP0, False, D_A, False, width)
    for m in range(width):
        for i in range(9):
            w[stress + 9 * m + i] = w[ONE + width * i + m]
            w[D_FP1 + i] = -w[TWO + width * i + m]
        _normalised(w, state + 9 * m, D_FP1)


@kernel
def derivative(
    w: FloatArray,
    p: FloatArray,
    skin: float,
    dt: float,
    exponential: bool,
    coupled: bool,
    constant: bool,
    dH: FloatArray,
    dR: FloatArray,
    dp: FloatArray,
    dskin: float,
    dstate0: FloatArray,
    gains: FloatArray,
    dP: FloatArray,
    dstate1: FloatArray,
) -> None:
    """Directional derivative of stress and state of the step that is in the workspace.

    constant: whether dp and dskin are null; gains: of `slip_derivatives.slip_gains`.
    """
    for i in range(9):
        w[D_FP0 + i] = dstate0[i]
    left(w, TWO, FT, False, D_FP0, False, 1)
    right(w, ONE, TWO, False, UNDONE, False, 1)
    for i in range(9):
        w[ONE + i] += dH[i] + dR[i]
    _split_off_spin(w)
    for s in range(NS):
        w[EXPLICIT + s] = 0.0
    elastic = dp[P_C11] != 0.0 or dp[P_C12] != 0.0 or dp[P_C44] != 0.0
    if elastic:
        # Change of Fe·S owed to the constants, and its resolved shear stresses.
        cubic(w, TWO, STRAIN, dp, 1)
        left(w, D_FE, FE, False, TWO, False, 1)
        left(w, TWO, TRIAL, True, D_FE, False, 1)
        to_modes(w, SCRATCH_MODES, TWO, 1)
        drive(w, p, SCRATCH_MODES, EXPLICIT)
        for s in range(NS):
            w[EXPLICIT + s] *= w[SIGN + s]
    if dp[P_A1] != 0.0:
        to_modes(w, SCRATCH_MODES, CONJUGATE_STRESS, 1)
        resolve(w, CONJUGATE_SCHMID, SCRATCH_MODES, OTHER)
        non_schmid_derivative(w, p, dp)
    explicit_derivative(w, dt, p, skin, exponential, coupled, constant, dp, dskin, dstate0)
    weigh_residual(w, EXPLICIT, coupled)
    condensed_change(w, p)
    total_slip_change(w, coupled)
    h0, h1, h2 = w[ONE], w[ONE + 1], w[ONE + 2]
    h3, h4, h5 = w[ONE + 3], w[ONE + 4], w[ONE + 5]
    h6, h7, h8 = w[ONE + 6], w[ONE + 7], w[ONE + 8]
    b = SLIP_BY_H
    for s in range(NS):
        w[STEP + s] += (
            w[b + s] * h0
            + w[b + NS + s] * h1
            + w[b + 2 * NS + s] * h2
            + w[b + 3 * NS + s] * h3
            + w[b + 4 * NS + s] * h4
            + w[b + 5 * NS + s] * h5
            + w[b + 6 * NS + s] * h6
            + w[b + 7 * NS + s] * h7
            + w[b + 8 * NS + s] * h8
        )
    finish_derivative(w, p, exponential, dp, gains, dstate0, dstate1)
    # dFp⁰⁻¹ outside the trial, then H, then A
    right(w, D_FP1, D_FP0, False, GAIN, False, 1)
    _normalised(w, D_STATE, D_FP1)
    left(w, D_PIOLA, PULLED, False, D_FP0, True, 1)
    left(w, TWO, SPIN, False, PIOLA, False, 1)
    add(w, D_PIOLA, TWO, 1.0, 1)
    if elastic:
        left(w, TWO, D_FE, False, GAIN, True, 1)
        left(w, D_FE, TWO, False, FP0, True, 1)
        add(w, D_PIOLA, D_FE, 1.0, 1)
    _add_products(w, D_PIOLA, P_BY_H, ONE, 9)
    _add_products(w, D_PIOLA, P_BY_A, D_MODES, NM)
    _add_products(w, D_STATE, STATE_BY_H, ONE, 9)
    _add_products(w, D_STATE, STATE_BY_A, D_MODES, NM)
    for i in range(9):
        dP[i] = w[D_PIOLA + i]
        dstate1[i] = w[D_STATE + i]


@kernel
def _add_products(w: FloatArray, target: int, matrix: int, source: int, count: int) -> None:
    """Add Σ_j matrix_j source_j to the nine numbers at target, for matrix (count, 9)."""
    t0 = t1 = t2 = t3 = t4 = t5 = t6 = t7 = t8 = 0.0
    for j in range(count):
        x, r = w[source + j], matrix + 9 * j
        t0 += w[r] * x
        t1 += w[r + 1] * x
        t2 += w[r + 2] * x
        t3 += w[r + 3] * x
        t4 += w[r + 4] * x
        t5 += w[r + 5] * x
        t6 += w[r + 6] * x
        t7 += w[r + 7] * x
        t8 += w[r + 8] * x
    w[target], w[target + 1], w[target + 2] = w[target] + t0, w[target + 1] + t1, w[target + 2] + t2
    w[target + 3], w[target + 4] = w[target + 3] + t3, w[target + 4] + t4
    w[target + 5], w[target + 6] = w[target + 5] + t5, w[target + 6] + t6
    w[target + 7], w[target + 8] = w[target + 7] + t7, w[target + 8] + t8
