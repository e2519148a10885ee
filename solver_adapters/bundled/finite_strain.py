"""Crystal law at a Gauss point in finite strain, F = Fe·Fp, crystal axes on the material side.

Steps of an update (F is the deformation gradient times the crystal rotation):
1. trial Fe* = F·Fp⁰⁻¹, A = Σ S Δp m⊗n, Fe = Fe*·(I − A), so that Fp⁻¹ = Fp⁰⁻¹·(I − A);
2. S = C : ½(FeᵀFe − I), energy-conjugate stress T = Fe*ᵀ·Fe·S, resolved shear τ = T : m⊗n;
   T = −∂W/∂A makes the condensed system and the tangent symmetric;
3. the 24 residuals, linearised in Δp and condensed to (I + H·Y) δA = Σ S w f N + H δT*,
   H = Σ w N Nᵀ, Y = −∂T/∂A (9 × 9);
4. slips updated from δτ = −N·Y δA; 2–4 repeated until no slip changes;
5. first Piola–Kirchhoff stress P = Fe·S·(I − A)ᵀ·Fp⁰⁻ᵀ; Fp⁻¹ is scaled to unit determinant.
"""

import numpy as np
from numpy.typing import NDArray

from solver_adapters.bundled.compilation import kernel
from solver_adapters.bundled.law import NS, P_C11, P_C12, P_C44
from solver_adapters.bundled.slip import (
    D_TAU,
    EXPLICIT,
    LOAD,
    N_SLIP_ROWS,
    SIGN,
    SLIP,
    TAU,
    WEIGHT,
    advance_slips,
    derivative_load,
    evaluate_systems,
    explicit_derivative,
    finish_derivative,
    load_point,
    store_slips,
)

FloatArray = NDArray[np.float64]

SCHMID_ROWS = N_SLIP_ROWS  # m⊗n, 9 × 24
FT = SCHMID_ROWS + 9 * NS  # F
FP0 = FT + 9  # Fp⁰⁻¹
TRIAL = FP0 + 9  # Fe*
FE = TRIAL + 9
STRAIN = FE + 9
STRESS = STRAIN + 9  # S
FES = STRESS + 9  # Fe·S
CONJUGATE = FES + 9  # T
GAIN = CONJUGATE + 9  # I − A
D_A = GAIN + 9
D_TRIAL = D_A + 9
D_FE = D_TRIAL + 9
D_S = D_FE + 9
D_T = D_S + 9
ONE = D_T + 9
TWO = ONE + 9
FP1 = TWO + 9
SLIP_STIFFNESS = FP1 + 9  # H, 9 × 9
SOFTENING = SLIP_STIFFNESS + 81  # Y, 9 × 9
FACTOR = SOFTENING + 81  # LU of I + H·Y with inverse pivots
WORKSPACE = FACTOR + 81


@kernel
def prepare(w: FloatArray, schmid: FloatArray) -> None:
    """Put the constant Schmid tensors into a fresh workspace."""
    for i in range(9):
        for s in range(NS):
            w[SCHMID_ROWS + i * NS + s] = schmid[i, s]


@kernel
def _product(w: FloatArray, c: int, a: int, b: int) -> None:
    for i in range(3):
        for j in range(3):
            w[c + 3 * i + j] = (
                w[a + 3 * i] * w[b + j]
                + w[a + 3 * i + 1] * w[b + 3 + j]
                + w[a + 3 * i + 2] * w[b + 6 + j]
            )


@kernel
def _product_left_transposed(w: FloatArray, c: int, a: int, b: int) -> None:
    for i in range(3):
        for j in range(3):
            w[c + 3 * i + j] = (
                w[a + i] * w[b + j] + w[a + 3 + i] * w[b + 3 + j] + w[a + 6 + i] * w[b + 6 + j]
            )


@kernel
def _product_right_transposed(w: FloatArray, c: int, a: int, b: int) -> None:
    for i in range(3):
        for j in range(3):
            w[c + 3 * i + j] = (
                w[a + 3 * i] * w[b + 3 * j]
                + w[a + 3 * i + 1] * w[b + 3 * j + 1]
                + w[a + 3 * i + 2] * w[b + 3 * j + 2]
            )


@kernel
def _accumulate(w: FloatArray, a: int, b: int, factor: float) -> None:
    for i in range(9):
        w[a + i] += factor * w[b + i]


@kernel
def _cubic(w: FloatArray, s: int, e: int, C11: float, C12: float, C44: float) -> None:
    """S = C : sym(e)."""
    trace = w[e] + w[e + 4] + w[e + 8]
    for i in range(3):
        w[s + 4 * i] = (C11 - C12) * w[e + 4 * i] + C12 * trace
    for i in range(3):
        for j in range(i):
            shear = C44 * (w[e + 3 * i + j] + w[e + 3 * j + i])
            w[s + 3 * i + j] = shear
            w[s + 3 * j + i] = shear


@kernel
def _contract(w: FloatArray, source: int, target: int) -> None:
    """Over the systems: target_s = source : (m⊗n)_s."""
    t0, t1, t2 = w[source], w[source + 1], w[source + 2]
    t3, t4, t5 = w[source + 3], w[source + 4], w[source + 5]
    t6, t7, t8 = w[source + 6], w[source + 7], w[source + 8]
    r = SCHMID_ROWS
    for s in range(NS):
        w[target + s] = (
            w[r + s] * t0
            + w[r + NS + s] * t1
            + w[r + 2 * NS + s] * t2
            + w[r + 3 * NS + s] * t3
            + w[r + 4 * NS + s] * t4
            + w[r + 5 * NS + s] * t5
            + w[r + 6 * NS + s] * t6
            + w[r + 7 * NS + s] * t7
            + w[r + 8 * NS + s] * t8
        )


@kernel
def _stresses(w: FloatArray, p: FloatArray) -> None:
    for i in range(9):
        total = 0.0
        for s in range(NS):
            total += w[SCHMID_ROWS + i * NS + s] * w[SIGN + s] * w[SLIP + s]
        w[GAIN + i] = -total
    for i in range(3):
        w[GAIN + 4 * i] += 1.0
    _product(w, FE, TRIAL, GAIN)
    _product_left_transposed(w, STRAIN, FE, FE)
    for i in range(3):
        w[STRAIN + 4 * i] -= 1.0
    for i in range(9):
        w[STRAIN + i] *= 0.5
    _cubic(w, STRESS, STRAIN, p[P_C11], p[P_C12], p[P_C44])
    _product(w, FES, FE, STRESS)
    _product_left_transposed(w, CONJUGATE, TRIAL, FES)
    _contract(w, CONJUGATE, TAU)


@kernel
def _strain_change(w: FloatArray, p: FloatArray) -> None:
    """D_S = C : (Feᵀ D_FE), then ONE = D_FE·S + Fe·D_S."""
    _product_left_transposed(w, ONE, FE, D_FE)
    _cubic(w, D_S, ONE, p[P_C11], p[P_C12], p[P_C44])


@kernel
def _force_change(w: FloatArray) -> None:
    _product(w, ONE, D_FE, STRESS)
    _product(w, TWO, FE, D_S)
    _accumulate(w, ONE, TWO, 1.0)


@kernel
def _condense(w: FloatArray, p: FloatArray) -> None:
    r = SCHMID_ROWS
    for i in range(9):
        for j in range(i + 1):
            total = 0.0
            for s in range(NS):
                total += w[r + i * NS + s] * w[r + j * NS + s] * w[WEIGHT + s]
            w[SLIP_STIFFNESS + 9 * i + j] = total
            w[SLIP_STIFFNESS + 9 * j + i] = total
    for j in range(9):
        for i in range(9):
            w[D_A + i] = 0.0
        w[D_A + j] = 1.0
        _product(w, D_FE, TRIAL, D_A)
        _strain_change(w, p)
        _force_change(w)
        _product_left_transposed(w, TWO, TRIAL, ONE)
        for i in range(9):
            w[SOFTENING + 9 * i + j] = w[TWO + i]
    for i in range(9):
        for j in range(9):
            total = 0.0
            for k in range(9):
                total += w[SLIP_STIFFNESS + 9 * i + k] * w[SOFTENING + 9 * k + j]
            w[FACTOR + 9 * i + j] = total
        w[FACTOR + 10 * i] += 1.0
    # No pivoting: the eigenvalues of I + H·Y, a product of two positive matrices plus I, are ≥ 1.
    for k in range(9):
        inverse = 1.0 / w[FACTOR + 10 * k]
        w[FACTOR + 10 * k] = inverse
        for i in range(k + 1, 9):
            ratio = w[FACTOR + 9 * i + k] * inverse
            w[FACTOR + 9 * i + k] = ratio
            for j in range(k + 1, 9):
                w[FACTOR + 9 * i + j] -= ratio * w[FACTOR + 9 * k + j]


@kernel
def _solve(w: FloatArray, b: int) -> None:
    for i in range(9):
        t = w[b + i]
        for k in range(i):
            t -= w[FACTOR + 9 * i + k] * w[b + k]
        w[b + i] = t
    for i in range(8, -1, -1):
        t = w[b + i]
        for k in range(i + 1, 9):
            t -= w[FACTOR + 9 * i + k] * w[b + k]
        w[b + i] = t * w[FACTOR + 10 * i]


@kernel
def _slip_gradient(w: FloatArray) -> None:
    """D_A = (I + H·Y)⁻¹ Σ LOAD m⊗n, then D_TAU = −(m⊗n) : Y D_A."""
    for i in range(9):
        total = 0.0
        for s in range(NS):
            total += w[SCHMID_ROWS + i * NS + s] * w[LOAD + s]
        w[D_A + i] = total
    _solve(w, D_A)
    for i in range(9):
        total = 0.0
        for j in range(9):
            total -= w[SOFTENING + 9 * i + j] * w[D_A + j]
        w[TWO + i] = total
    _contract(w, TWO, D_TAU)


@kernel
def update(
    w: FloatArray,
    H: FloatArray,
    R: FloatArray,
    p: FloatArray,
    dt: float,
    state0: FloatArray,
    guess: FloatArray,
    tolerance: float,
    most: int,
) -> int:
    """Solve a step at one point; returns the iterations, negative if it did not converge.

    H: displacement gradient ∂u/∂X·R (9); R: crystal → specimen rotation (9); guess: S Δp (24).
    """
    load_point(w, state0, p, guess)
    for i in range(9):
        w[FT + i] = R[i] + H[i]
        w[FP0 + i] = state0[i]
    _product(w, TRIAL, FT, FP0)
    count = 0
    change = 1.0
    while change > tolerance and count < most:
        _stresses(w, p)
        evaluate_systems(w, dt, p, True)
        _condense(w, p)
        _slip_gradient(w)
        change = advance_slips(w, p)
        count += 1
    _stresses(w, p)
    evaluate_systems(w, dt, p, False)
    _condense(w, p)
    return count if change <= tolerance else -count


@kernel
def store(
    w: FloatArray,
    state1: FloatArray,
    slips: FloatArray,
    P: FloatArray,
) -> None:
    """First Piola–Kirchhoff stress times R (9) and the state at the end of the step."""
    _product_right_transposed(w, ONE, FES, GAIN)
    _product_right_transposed(w, TWO, ONE, FP0)
    for i in range(9):
        P[i] = w[TWO + i]
    _product(w, FP1, FP0, GAIN)
    scale = _determinant(w, FP1) ** (-1.0 / 3.0)
    for i in range(9):
        state1[i] = w[FP1 + i] * scale
    store_slips(w, state1, slips)


@kernel
def _determinant(w: FloatArray, a: int) -> float:
    return (
        w[a] * (w[a + 4] * w[a + 8] - w[a + 5] * w[a + 7])
        - w[a + 1] * (w[a + 3] * w[a + 8] - w[a + 5] * w[a + 6])
        + w[a + 2] * (w[a + 3] * w[a + 7] - w[a + 4] * w[a + 6])
    )


@kernel
def _determinant_change(w: FloatArray, a: int, b: int) -> float:
    """Derivative of det(a) along b: cofactor(a) : b."""
    total = 0.0
    for i in range(3):
        i1, i2 = (i + 1) % 3, (i + 2) % 3
        for j in range(3):
            j1, j2 = (j + 1) % 3, (j + 2) % 3
            total += w[b + 3 * i + j] * (
                w[a + 3 * i1 + j1] * w[a + 3 * i2 + j2] - w[a + 3 * i1 + j2] * w[a + 3 * i2 + j1]
            )
    return total


@kernel
def _trial_change(w: FloatArray, p: FloatArray, dp: FloatArray) -> None:
    """D_T, the change of T at fixed slips for D_TRIAL and elastic constants; D_FE, D_S with it."""
    _product(w, D_FE, D_TRIAL, GAIN)
    _strain_change(w, p)
    _cubic(w, TWO, STRAIN, dp[P_C11], dp[P_C12], dp[P_C44])
    _accumulate(w, D_S, TWO, 1.0)
    _force_change(w)
    _product_left_transposed(w, D_T, TRIAL, ONE)
    _product_left_transposed(w, TWO, D_TRIAL, FES)
    _accumulate(w, D_T, TWO, 1.0)


@kernel
def _stress_change(w: FloatArray, p: FloatArray, dp: FloatArray) -> None:
    """D_FE completed by the slips (D_A); TWO = change of Fe·S·(I − A)ᵀ."""
    _product(w, TWO, TRIAL, D_A)
    _accumulate(w, D_FE, TWO, -1.0)
    _strain_change(w, p)
    _cubic(w, TWO, STRAIN, dp[P_C11], dp[P_C12], dp[P_C44])
    _accumulate(w, D_S, TWO, 1.0)
    _force_change(w)
    _product_right_transposed(w, TWO, ONE, GAIN)
    _product_right_transposed(w, ONE, FES, D_A)
    _accumulate(w, TWO, ONE, -1.0)


@kernel
def tangent(w: FloatArray, zero: FloatArray, p: FloatArray, C: FloatArray) -> None:
    """Consistent tangent ∂P/∂H (9, 9); ``zero``: null derivative of the local parameters."""
    for j in range(9):
        row, column = j // 3, j % 3
        for i in range(9):
            w[D_TRIAL + i] = 0.0
        for k in range(3):
            w[D_TRIAL + 3 * row + k] = w[FP0 + 3 * column + k]
        _trial_change(w, p, zero)
        for i in range(9):
            total = 0.0
            for k in range(9):
                total += w[SLIP_STIFFNESS + 9 * i + k] * w[D_T + k]
            w[D_A + i] = total
        _solve(w, D_A)
        _stress_change(w, p, zero)
        _product_right_transposed(w, ONE, TWO, FP0)
        for i in range(9):
            C[i, j] = w[ONE + i]


@kernel
def derivative(
    w: FloatArray,
    p: FloatArray,
    dt: float,
    dH: FloatArray,
    dR: FloatArray,
    dp: FloatArray,
    dstate0: FloatArray,
    dP: FloatArray,
    dstate1: FloatArray,
) -> None:
    """Directional derivative of stress and state of the step that is in the workspace."""
    for i in range(9):
        w[ONE + i] = dH[i] + dR[i]
        w[D_S + i] = dstate0[i]
    _product(w, D_TRIAL, ONE, FP0)
    _product(w, TWO, FT, D_S)
    _accumulate(w, D_TRIAL, TWO, 1.0)
    _trial_change(w, p, dp)
    _contract(w, D_T, EXPLICIT)
    for s in range(NS):
        w[EXPLICIT + s] *= w[SIGN + s]
    explicit_derivative(w, dt, p, dp, dstate0)
    derivative_load(w)
    _slip_gradient(w)
    finish_derivative(w, p, dp, dstate0, dstate1)
    _stress_change(w, p, dp)
    _product_right_transposed(w, ONE, TWO, FP0)
    for i in range(9):
        dP[i] = w[ONE + i]
        w[D_S + i] = dstate0[i]
    _product_right_transposed(w, ONE, FES, GAIN)
    _product_right_transposed(w, TWO, ONE, D_S)
    for i in range(9):
        dP[i] += w[TWO + i]
    # Fp⁻¹ = Fp⁰⁻¹·(I − A), scaled to unit determinant
    _product(w, ONE, D_S, GAIN)
    _product(w, TWO, FP0, D_A)
    _accumulate(w, ONE, TWO, -1.0)
    _product(w, FP1, FP0, GAIN)
    determinant = _determinant(w, FP1)
    growth = _determinant_change(w, FP1, ONE) / (3.0 * determinant)
    scale = determinant ** (-1.0 / 3.0)
    for i in range(9):
        dstate1[i] = scale * (w[ONE + i] - w[FP1 + i] * growth)
