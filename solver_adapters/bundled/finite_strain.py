"""Crystal law at a Gauss point in finite strain, F = Fe·Fp, crystal axes on the material side.

Steps of an update (F is the deformation gradient times the crystal rotation):
1. trial Fe* = F·Fp⁰⁻¹, A = Σ S Δp m⊗n, Fe = Fe*·(I − A), so that Fp⁻¹ = Fp⁰⁻¹·(I − A);
2. S = C : ½(FeᵀFe − I), energy-conjugate stress T = Fe*ᵀ·Fe·S, resolved shear τ = T : m⊗n;
   T = −∂W/∂A makes the condensed system and the tangent symmetric;
3. the 24 residuals, linearised in Δp and condensed to (I + H·Y) δA = Σ S w f N, H = Σ w N Nᵀ,
   Y = −∂T/∂A, in the eight orthonormal modes of a tensor without trace (8 × 8);
4. slips updated from δτ = −N·Y δA; 2–4 repeated until no slip changes;
5. first Piola–Kirchhoff stress P = Fe·S·(I − A)ᵀ·Fp⁰⁻ᵀ; Fp⁻¹ is scaled to unit determinant.

Names with D_ are changes along `width` directions at once, stored component first: the loops
over directions vectorise, and the same formulas serve Y (8 directions), the tangent (9) and a
derivative (1).
"""

import numpy as np
from numpy.typing import NDArray

from solver_adapters.bundled.compilation import kernel
from solver_adapters.bundled.dense import factor, solve
from solver_adapters.bundled.law import NS, P_C11, P_C12, P_C44
from solver_adapters.bundled.slip import (
    D_TAU,
    EXPLICIT,
    LOAD,
    N_SLIP_ROWS,
    SIGN,
    SIGNED,
    TAU,
    WEIGHT,
    WEIGHTED,
    advance_slips,
    derivative_load,
    evaluate_systems,
    explicit_derivative,
    finish_derivative,
    load_point,
    store_slips,
)

FloatArray = NDArray[np.float64]

NM = 8  # modes of a tensor without trace
SCHMID = N_SLIP_ROWS  # modes of m⊗n, 8 × 24
FT = SCHMID + NM * NS  # F
FP0 = FT + 9  # Fp⁰⁻¹
TRIAL = FP0 + 9  # Fe*
FE = TRIAL + 9
STRAIN = FE + 9
STRESS = STRAIN + 9  # S
FES = STRESS + 9  # Fe·S
CONJUGATE = FES + 9  # T
GAIN = CONJUGATE + 9  # I − A
FP1 = GAIN + 9
D_FP0 = FP1 + 9
MODES = D_FP0 + 9  # eight modes of a tensor
FORCE = MODES + NM  # eight modes of a tensor
UNIT = FORCE + NM  # the eight modes themselves as tensors, 9 × 8
SLIP_STIFFNESS = UNIT + 9 * NM  # H, 8 × 8
SOFTENING = SLIP_STIFFNESS + NM * NM  # Y, 8 × 8
FACTOR = SOFTENING + NM * NM  # LU of I + H·Y, 8 × 8
D_TRIAL = FACTOR + NM * NM
D_FE = D_TRIAL + 81
D_S = D_FE + 81
D_T = D_S + 81
D_A = D_T + 81
D_MODES = D_A + 81
ONE = D_MODES + 81
TWO = ONE + 81
WORKSPACE = TWO + 81

_R2, _R6 = 1 / np.sqrt(2.0), 1 / np.sqrt(6.0)


@kernel
def prepare(w: FloatArray, schmid: FloatArray) -> None:
    """Put the modes (8, 24) of the Schmid tensors into a fresh workspace."""
    for k in range(NM):
        for s in range(NS):
            w[SCHMID + k * NS + s] = schmid[k, s]
    for k in range(NM):
        w[D_MODES + NM * k + k] = 1.0
    _tensors(w, UNIT, D_MODES, NM)


@kernel
def _product(w: FloatArray, c: int, a: int, turn_a: bool, b: int, turn_b: bool) -> None:
    """c = a·b of single tensors; a or b transposed where asked."""
    row_a, column_a = (1, 3) if turn_a else (3, 1)
    row_b, column_b = (1, 3) if turn_b else (3, 1)
    for i in range(3):
        for j in range(3):
            w[c + 3 * i + j] = (
                w[a + row_a * i] * w[b + column_b * j]
                + w[a + row_a * i + column_a] * w[b + column_b * j + row_b]
                + w[a + row_a * i + 2 * column_a] * w[b + column_b * j + 2 * row_b]
            )


@kernel
def _left(w: FloatArray, c: int, a: int, turn_a: bool, b: int, turn_b: bool, width: int) -> None:
    """c_m = a·b_m of each direction m; a or b transposed where asked."""
    row, column = (1, 3) if turn_a else (3, 1)
    a0, a1, a2 = w[a], w[a + column], w[a + 2 * column]
    a3, a4, a5 = w[a + row], w[a + 4], w[a + row + 2 * column]
    a6, a7, a8 = w[a + 2 * row], w[a + 2 * row + column], w[a + 8]
    row, column = (width, 3 * width) if turn_b else (3 * width, width)
    for m in range(width):
        b0, b1, b2 = w[b + m], w[b + column + m], w[b + 2 * column + m]
        b3, b4, b5 = w[b + row + m], w[b + 4 * width + m], w[b + row + 2 * column + m]
        b6, b7, b8 = w[b + 2 * row + m], w[b + 2 * row + column + m], w[b + 8 * width + m]
        w[c + m] = a0 * b0 + a1 * b3 + a2 * b6
        w[c + width + m] = a0 * b1 + a1 * b4 + a2 * b7
        w[c + 2 * width + m] = a0 * b2 + a1 * b5 + a2 * b8
        w[c + 3 * width + m] = a3 * b0 + a4 * b3 + a5 * b6
        w[c + 4 * width + m] = a3 * b1 + a4 * b4 + a5 * b7
        w[c + 5 * width + m] = a3 * b2 + a4 * b5 + a5 * b8
        w[c + 6 * width + m] = a6 * b0 + a7 * b3 + a8 * b6
        w[c + 7 * width + m] = a6 * b1 + a7 * b4 + a8 * b7
        w[c + 8 * width + m] = a6 * b2 + a7 * b5 + a8 * b8


@kernel
def _right(w: FloatArray, c: int, b: int, turn_b: bool, a: int, turn_a: bool, width: int) -> None:
    """c_m = b_m·a of each direction m; a or b transposed where asked."""
    row, column = (1, 3) if turn_a else (3, 1)
    a0, a1, a2 = w[a], w[a + column], w[a + 2 * column]
    a3, a4, a5 = w[a + row], w[a + 4], w[a + row + 2 * column]
    a6, a7, a8 = w[a + 2 * row], w[a + 2 * row + column], w[a + 8]
    row, column = (width, 3 * width) if turn_b else (3 * width, width)
    for m in range(width):
        b0, b1, b2 = w[b + m], w[b + column + m], w[b + 2 * column + m]
        b3, b4, b5 = w[b + row + m], w[b + 4 * width + m], w[b + row + 2 * column + m]
        b6, b7, b8 = w[b + 2 * row + m], w[b + 2 * row + column + m], w[b + 8 * width + m]
        w[c + m] = b0 * a0 + b1 * a3 + b2 * a6
        w[c + width + m] = b0 * a1 + b1 * a4 + b2 * a7
        w[c + 2 * width + m] = b0 * a2 + b1 * a5 + b2 * a8
        w[c + 3 * width + m] = b3 * a0 + b4 * a3 + b5 * a6
        w[c + 4 * width + m] = b3 * a1 + b4 * a4 + b5 * a7
        w[c + 5 * width + m] = b3 * a2 + b4 * a5 + b5 * a8
        w[c + 6 * width + m] = b6 * a0 + b7 * a3 + b8 * a6
        w[c + 7 * width + m] = b6 * a1 + b7 * a4 + b8 * a7
        w[c + 8 * width + m] = b6 * a2 + b7 * a5 + b8 * a8


@kernel
def _add(w: FloatArray, a: int, b: int, factor: float, width: int) -> None:
    for i in range(9 * width):
        w[a + i] += factor * w[b + i]


@kernel
def _modes(w: FloatArray, c: int, a: int, width: int) -> None:
    """The eight modes of tensors, in the order of `law.SLIP_MODES`."""
    for m in range(width):
        x, y, z = w[a + m], w[a + 4 * width + m], w[a + 8 * width + m]
        w[c + m] = _R2 * (x - y)
        w[c + width + m] = _R6 * (2.0 * z - x - y)
        w[c + 2 * width + m] = _R2 * (w[a + 5 * width + m] + w[a + 7 * width + m])
        w[c + 3 * width + m] = _R2 * (w[a + 2 * width + m] + w[a + 6 * width + m])
        w[c + 4 * width + m] = _R2 * (w[a + width + m] + w[a + 3 * width + m])
        w[c + 5 * width + m] = _R2 * (w[a + 5 * width + m] - w[a + 7 * width + m])
        w[c + 6 * width + m] = _R2 * (w[a + 2 * width + m] - w[a + 6 * width + m])
        w[c + 7 * width + m] = _R2 * (w[a + width + m] - w[a + 3 * width + m])


@kernel
def _tensors(w: FloatArray, c: int, a: int, width: int) -> None:
    """The tensors of eight modes."""
    for m in range(width):
        x, y = _R2 * w[a + m], _R6 * w[a + width + m]
        w[c + m] = x - y
        w[c + 4 * width + m] = -x - y
        w[c + 8 * width + m] = 2.0 * y
        w[c + 5 * width + m] = _R2 * (w[a + 2 * width + m] + w[a + 5 * width + m])
        w[c + 7 * width + m] = _R2 * (w[a + 2 * width + m] - w[a + 5 * width + m])
        w[c + 2 * width + m] = _R2 * (w[a + 3 * width + m] + w[a + 6 * width + m])
        w[c + 6 * width + m] = _R2 * (w[a + 3 * width + m] - w[a + 6 * width + m])
        w[c + width + m] = _R2 * (w[a + 4 * width + m] + w[a + 7 * width + m])
        w[c + 3 * width + m] = _R2 * (w[a + 4 * width + m] - w[a + 7 * width + m])


@kernel
def _cubic(w: FloatArray, s: int, e: int, p: FloatArray, width: int) -> None:
    """S = C : sym(e)."""
    difference, C12, C44 = p[P_C11] - p[P_C12], p[P_C12], p[P_C44]
    for m in range(width):
        x, y, z = w[e + m], w[e + 4 * width + m], w[e + 8 * width + m]
        volume = C12 * (x + y + z)
        xy = C44 * (w[e + width + m] + w[e + 3 * width + m])
        xz = C44 * (w[e + 2 * width + m] + w[e + 6 * width + m])
        yz = C44 * (w[e + 5 * width + m] + w[e + 7 * width + m])
        w[s + m] = difference * x + volume
        w[s + width + m] = xy
        w[s + 2 * width + m] = xz
        w[s + 3 * width + m] = xy
        w[s + 4 * width + m] = difference * y + volume
        w[s + 5 * width + m] = yz
        w[s + 6 * width + m] = xz
        w[s + 7 * width + m] = yz
        w[s + 8 * width + m] = difference * z + volume


@kernel
def _over_modes(w: FloatArray, c: int, a: int, b: int, width: int) -> None:
    """Matrix (8 × 8) times modes: c_im = Σ_k a_ik b_km."""
    for i in range(NM):
        r = a + NM * i
        a0, a1, a2, a3 = w[r], w[r + 1], w[r + 2], w[r + 3]
        a4, a5, a6, a7 = w[r + 4], w[r + 5], w[r + 6], w[r + 7]
        for m in range(width):
            w[c + width * i + m] = (
                a0 * w[b + m]
                + a1 * w[b + width + m]
                + a2 * w[b + 2 * width + m]
                + a3 * w[b + 3 * width + m]
                + a4 * w[b + 4 * width + m]
                + a5 * w[b + 5 * width + m]
                + a6 * w[b + 6 * width + m]
                + a7 * w[b + 7 * width + m]
            )


@kernel
def _contract(w: FloatArray, source: int, target: int) -> None:
    """Over the systems: target_s = source : (m⊗n)_s, both in modes."""
    t0, t1, t2, t3 = w[source], w[source + 1], w[source + 2], w[source + 3]
    t4, t5, t6, t7 = w[source + 4], w[source + 5], w[source + 6], w[source + 7]
    r = SCHMID
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
        )


@kernel
def _project(w: FloatArray, target: int, source: int) -> None:
    """target = Σ source_s (m⊗n)_s, a sum over the systems in modes."""
    t0 = t1 = t2 = t3 = t4 = t5 = t6 = t7 = 0.0
    for s in range(NS):
        x = w[source + s]
        t0 += w[SCHMID + s] * x
        t1 += w[SCHMID + NS + s] * x
        t2 += w[SCHMID + 2 * NS + s] * x
        t3 += w[SCHMID + 3 * NS + s] * x
        t4 += w[SCHMID + 4 * NS + s] * x
        t5 += w[SCHMID + 5 * NS + s] * x
        t6 += w[SCHMID + 6 * NS + s] * x
        t7 += w[SCHMID + 7 * NS + s] * x
    w[target], w[target + 1], w[target + 2], w[target + 3] = t0, t1, t2, t3
    w[target + 4], w[target + 5], w[target + 6], w[target + 7] = t4, t5, t6, t7


@kernel
def _stresses(w: FloatArray, p: FloatArray) -> None:
    _project(w, MODES, SIGNED)
    _tensors(w, ONE, MODES, 1)
    for i in range(9):
        w[GAIN + i] = -w[ONE + i]
    for i in range(3):
        w[GAIN + 4 * i] += 1.0
    _product(w, FE, TRIAL, False, GAIN, False)
    _product(w, STRAIN, FE, True, FE, False)
    for i in range(3):
        w[STRAIN + 4 * i] -= 1.0
    for i in range(9):
        w[STRAIN + i] *= 0.5
    _cubic(w, STRESS, STRAIN, p, 1)
    _product(w, FES, FE, False, STRESS, False)
    _product(w, CONJUGATE, TRIAL, True, FES, False)
    _modes(w, MODES, CONJUGATE, 1)
    _contract(w, MODES, TAU)


@kernel
def _force_change(w: FloatArray, p: FloatArray, width: int) -> None:
    """D_S = C : (Feᵀ·D_FE), then ONE = D_FE·S + Fe·D_S."""
    _left(w, ONE, FE, True, D_FE, False, width)
    _cubic(w, D_S, ONE, p, width)
    _right(w, ONE, D_FE, False, STRESS, False, width)
    _left(w, TWO, FE, False, D_S, False, width)
    _add(w, ONE, TWO, 1.0, width)


@kernel
def _condense(w: FloatArray, p: FloatArray) -> None:
    for i in range(NM):
        for s in range(NS):
            w[WEIGHTED + s] = w[SCHMID + i * NS + s] * w[WEIGHT + s]
        _project(w, SLIP_STIFFNESS + NM * i, WEIGHTED)
    _left(w, D_FE, TRIAL, False, UNIT, False, NM)
    _force_change(w, p, NM)
    _left(w, TWO, TRIAL, True, ONE, False, NM)
    _modes(w, SOFTENING, TWO, NM)
    _over_modes(w, FACTOR, SLIP_STIFFNESS, SOFTENING, NM)
    for k in range(NM):
        w[FACTOR + (NM + 1) * k] += 1.0
    # No pivoting: in these modes Y is near the diagonal of the elastic constants (near 0 for the
    # spins) and H is positive, so that the pivots are ≥ 1 or close to it.
    factor(w, FACTOR, NM)


@kernel
def _slip_gradient(w: FloatArray) -> None:
    """D_MODES = (I + H·Y)⁻¹ Σ LOAD m⊗n, then D_TAU = −(m⊗n) : Y D_MODES."""
    _project(w, D_MODES, LOAD)
    solve(w, FACTOR, NM, D_MODES, 1)
    _over_modes(w, FORCE, SOFTENING, D_MODES, 1)
    for k in range(NM):
        w[FORCE + k] = -w[FORCE + k]
    _contract(w, FORCE, D_TAU)


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
    _product(w, TRIAL, FT, False, FP0, False)
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
    _product(w, ONE, FES, False, GAIN, True)
    _product(w, TWO, ONE, False, FP0, True)
    for i in range(9):
        P[i] = w[TWO + i]
    _product(w, FP1, FP0, False, GAIN, False)
    scale = _determinant(w, FP1) ** (-1.0 / 3.0)
    for i in range(9):
        state1[i] = w[FP1 + i] * scale
    store_slips(w, state1, slips)


@kernel
def _determinant(w: FloatArray, a: int) -> float:
    determinant: float = (
        w[a] * (w[a + 4] * w[a + 8] - w[a + 5] * w[a + 7])
        - w[a + 1] * (w[a + 3] * w[a + 8] - w[a + 5] * w[a + 6])
        + w[a + 2] * (w[a + 3] * w[a + 7] - w[a + 4] * w[a + 6])
    )
    return determinant


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
def _trial_change(w: FloatArray, p: FloatArray, width: int) -> None:
    """D_FE and D_T, the change of T at fixed slips and constants for D_TRIAL."""
    _right(w, D_FE, D_TRIAL, False, GAIN, False, width)
    _force_change(w, p, width)
    _left(w, D_T, TRIAL, True, ONE, False, width)
    _right(w, TWO, D_TRIAL, True, FES, False, width)
    _add(w, D_T, TWO, 1.0, width)


@kernel
def _stress_change(w: FloatArray, p: FloatArray, width: int) -> None:
    """TWO = change of Fe·S·(I − A)ᵀ at fixed constants; D_FE is completed by D_MODES."""
    _tensors(w, D_A, D_MODES, width)
    _left(w, TWO, TRIAL, False, D_A, False, width)
    _add(w, D_FE, TWO, -1.0, width)
    _force_change(w, p, width)
    _right(w, TWO, ONE, False, GAIN, True, width)
    _left(w, ONE, FES, False, D_A, True, width)
    _add(w, TWO, ONE, -1.0, width)


@kernel
def tangent(w: FloatArray, p: FloatArray, C: FloatArray) -> None:
    """Consistent tangent ∂P/∂H (9, 9)."""
    for i in range(81):
        w[D_TRIAL + i] = 0.0
    for row in range(3):
        for column in range(3):
            for k in range(3):
                w[D_TRIAL + 9 * (3 * row + k) + 3 * row + column] = w[FP0 + 3 * column + k]
    _trial_change(w, p, 9)
    _modes(w, ONE, D_T, 9)
    _over_modes(w, D_MODES, SLIP_STIFFNESS, ONE, 9)
    solve(w, FACTOR, NM, D_MODES, 9)
    _stress_change(w, p, 9)
    _right(w, ONE, TWO, False, FP0, True, 9)
    for i in range(9):
        for j in range(9):
            C[i, j] = w[ONE + 9 * i + j]


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
        w[D_FP0 + i] = dstate0[i]
    # 1. the trial and T at fixed slips; FP1 holds the change of Fe·S owed to the constants
    _product(w, D_TRIAL, ONE, False, FP0, False)
    _product(w, TWO, FT, False, D_FP0, False)
    _add(w, D_TRIAL, TWO, 1.0, 1)
    _trial_change(w, p, 1)
    _cubic(w, ONE, STRAIN, dp, 1)
    _product(w, FP1, FE, False, ONE, False)
    _product(w, TWO, TRIAL, True, FP1, False)
    _add(w, D_T, TWO, 1.0, 1)
    # 2. the slips
    _modes(w, MODES, D_T, 1)
    _contract(w, MODES, EXPLICIT)
    for s in range(NS):
        w[EXPLICIT + s] *= w[SIGN + s]
    explicit_derivative(w, dt, p, dp, dstate0)
    derivative_load(w)
    _slip_gradient(w)
    finish_derivative(w, p, dp, dstate0, dstate1)
    # 3. the stress
    _stress_change(w, p, 1)
    _product(w, ONE, FP1, False, GAIN, True)
    _add(w, TWO, ONE, 1.0, 1)
    _product(w, ONE, TWO, False, FP0, True)
    for i in range(9):
        dP[i] = w[ONE + i]
    _product(w, ONE, FES, False, GAIN, True)
    _product(w, TWO, ONE, False, D_FP0, True)
    for i in range(9):
        dP[i] += w[TWO + i]
    # 4. Fp⁻¹ = Fp⁰⁻¹·(I − A), scaled to unit determinant
    _product(w, ONE, D_FP0, False, GAIN, False)
    _product(w, TWO, FP0, False, D_A, False)
    _add(w, ONE, TWO, -1.0, 1)
    _product(w, FP1, FP0, False, GAIN, False)
    determinant = _determinant(w, FP1)
    growth = _determinant_change(w, FP1, ONE) / (3.0 * determinant)
    scale = determinant ** (-1.0 / 3.0)
    for i in range(9):
        dstate1[i] = scale * (w[ONE + i] - w[FP1 + i] * growth)
