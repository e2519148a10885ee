"""Crystal law at a Gauss point in finite strain, F = Fe·Fp, crystal axes on the material side.

Steps of an update (F is the deformation gradient times the crystal rotation):
1. trial Fe* = F·Fp⁰⁻¹, A = Σ S Δp m⊗n, Fe = Fe*·(I − A), so that Fp⁻¹ = Fp⁰⁻¹·(I − A);
2. S = C : ½(FeᵀFe − I), energy-conjugate stress T = Fe*ᵀ·Fe·S, resolved shear τ = T : m⊗n;
   T = −∂W/∂A makes the condensed system and the tangent symmetric;
3. the 24 residuals, linearised in Δp and condensed to (I + H·Y) δA = Σ S w f N, H = Σ w N Nᵀ,
   Y = −∂T/∂A, in the eight orthonormal modes of a tensor without trace (8 × 8);
4. slips updated from δτ = −N·Y δA; 2–4 repeated until the residuals ask for no more slip;
5. first Piola–Kirchhoff stress P = Fe·S·(I − A)ᵀ·Fp⁰⁻ᵀ; Fp⁻¹ is scaled to unit determinant.

With a non-Schmid term the second N of H is that of the driving stress; with latent hardening w is
a matrix. Both make the tangent unsymmetric.

Names with D_ are changes along several directions at once: the eight modes for Y, the nine
components of H for the tangent.
"""

from meshes.arrays import FloatArray
from solver_adapters.bundled.law.law import P_A1
from solver_adapters.bundled.law.small_lu import factor, solve
from solver_adapters.bundled.law.tensors import (
    NM,
    add,
    cubic,
    determinant_of,
    left,
    over_modes,
    right,
    to_modes,
    to_tensors,
)
from solver_adapters.kernels import kernel

from . import NS
from .law_terms import driving_modes
from .slip import (
    advance_slips,
    evaluate_systems,
    is_sound,
    load_point,
    prepare_slip,
    store_slips,
    weigh_mode,
)
from .workspace_layout import (
    D_TAU,
    LOAD,
    N_SLIP_ROWS,
    OTHER,
    SIGNED,
    TAU,
    WEIGHT,
    WEIGHTED,
)

SCHMID = N_SLIP_ROWS  # modes of m⊗n, 8 × NS
CONJUGATE_SCHMID = SCHMID + NM * NS  # modes of the conjugate tensors, 8 × NS
DRIVING = CONJUGATE_SCHMID + NM * NS  # modes of the driving stress where it is not Schmid's
FT = DRIVING + NM * NS  # F
FP0 = FT + 9  # Fp⁰⁻¹
TRIAL = FP0 + 9  # Fe*
FE = TRIAL + 9
STRAIN = FE + 9
STRESS = STRAIN + 9  # S
FES = STRESS + 9  # Fe·S
CONJUGATE_STRESS = FES + 9  # T
GAIN = CONJUGATE_STRESS + 9  # I − A
FP1 = GAIN + 9  # Fp⁰⁻¹·(I − A)
SCRATCH_MODES = FP1 + 9  # scratch: eight modes of a tensor
FORCE = SCRATCH_MODES + NM  # change of the modes of T
UNIT = FORCE + NM  # the eight modes themselves as tensors, 9 × 8
SLIP_STIFFNESS = UNIT + 9 * NM  # H, 8 × 8
SOFTENING = SLIP_STIFFNESS + NM * NM  # Y, 8 × 8
FACTOR = SOFTENING + NM * NM  # LU of I + H·Y, 8 × 8
D_FE = FACTOR + NM * NM  # along the modes, 9 × 8
D_S = D_FE + 9 * NM  # of S, 9 × 9
D_T = D_S + 81  # of T at fixed A, 9 × 9
D_A = D_T + 81  # of A, 9 × 9
D_MODES = D_A + 81  # modes of D_A, 8 × 9
T_BY_H = D_MODES + 9 * NM  # modes of ∂T/∂H at fixed A, 8 × 9
FIXED_BY_H = T_BY_H + 9 * NM  # ∂P/∂H at fixed A, 9 × 9
ONE = FIXED_BY_H + 81  # scratch, as the next
TWO = ONE + 81
# What `finite_derivative` prepares for all directions.
UNDONE = TWO + 81  # Fp⁰, the inverse of FP0
PULLED = UNDONE + 9  # Fe·S·(I − A)ᵀ
PIOLA = PULLED + 9  # P
UNLOADED = PIOLA + 9  # F⁻¹
STATE_BY_A = UNLOADED + 9  # derivative of Fp⁻¹ by the modes of A, 9 × 8
P_BY_H = STATE_BY_A + 9 * NM  # ∂P/∂H, 9 × 9
STATE_BY_H = P_BY_H + 81  # derivative of Fp⁻¹ by H, 9 × 9
SLIP_BY_H = STATE_BY_H + 81  # ∂Δp/∂H of the moving systems, one after the other, NS × 9
CONDENSED = SLIP_BY_H + 9 * NS  # (I + H·Y)⁻¹, 8 × 8
DILATION = CONDENSED + NM * NM  # derivative of ln det(Fp⁰⁻¹·(I − A))/3, 9
SCALE = DILATION + 9  # factor that gives Fp⁻¹ unit determinant, 1
WORKSPACE = SCALE + 1


@kernel
def prepare(
    w: FloatArray,
    schmid: FloatArray,
    conjugate: FloatArray,
    interaction: FloatArray,
    sense: FloatArray,
) -> None:
    """Put what is constant into a fresh workspace: modes (8, NS), and tables."""
    prepare_slip(w, interaction, sense)
    for k in range(NM):
        for s in range(NS):
            w[SCHMID + k * NS + s] = schmid[k, s]
            w[CONJUGATE_SCHMID + k * NS + s] = conjugate[k, s]
    for k in range(NM):
        w[D_MODES + NM * k + k] = 1.0
    to_tensors(w, UNIT, D_MODES, NM)


@kernel
def resolve(w: FloatArray, tensors: int, source: int, target: int) -> None:
    """Over the systems: target_s = source : tensor_s, both in modes."""
    t0, t1, t2, t3 = w[source], w[source + 1], w[source + 2], w[source + 3]
    t4, t5, t6, t7 = w[source + 4], w[source + 5], w[source + 6], w[source + 7]
    for s in range(NS):
        w[target + s] = (
            w[tensors + s] * t0
            + w[tensors + NS + s] * t1
            + w[tensors + 2 * NS + s] * t2
            + w[tensors + 3 * NS + s] * t3
            + w[tensors + 4 * NS + s] * t4
            + w[tensors + 5 * NS + s] * t5
            + w[tensors + 6 * NS + s] * t6
            + w[tensors + 7 * NS + s] * t7
        )


@kernel
def drive(w: FloatArray, p: FloatArray, source: int, target: int) -> None:
    """Change of the driving stress of each system along its sign."""
    if p[P_A1] != 0.0:
        resolve(w, DRIVING, source, target)
    else:
        resolve(w, SCHMID, source, target)


@kernel
def project(w: FloatArray, target: int, source: int) -> None:
    """Sum over the systems in modes: target = Σ source_s (m⊗n)_s."""
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
    project(w, SCRATCH_MODES, SIGNED)
    to_tensors(w, ONE, SCRATCH_MODES, 1)
    for i in range(9):
        w[GAIN + i] = -w[ONE + i]
    for i in range(3):
        w[GAIN + 4 * i] += 1.0
    left(w, FE, TRIAL, False, GAIN, False, 1)
    left(w, STRAIN, FE, True, FE, False, 1)
    for i in range(3):
        w[STRAIN + 4 * i] -= 1.0
    for i in range(9):
        w[STRAIN + i] *= 0.5
    cubic(w, STRESS, STRAIN, p, 1)
    left(w, FES, FE, False, STRESS, False, 1)
    left(w, CONJUGATE_STRESS, TRIAL, True, FES, False, 1)
    to_modes(w, SCRATCH_MODES, CONJUGATE_STRESS, 1)
    resolve(w, SCHMID, SCRATCH_MODES, TAU)


@kernel
def _evaluate(w: FloatArray, p: FloatArray, dt: float, exponential: bool, coupled: bool) -> float:
    """Residuals at the slips; returns how far from solved they are."""
    _stresses(w, p)
    error: float
    if p[P_A1] == 0.0:
        error = evaluate_systems(w, dt, p, exponential, coupled)
        return error
    resolve(w, CONJUGATE_SCHMID, SCRATCH_MODES, OTHER)
    error = evaluate_systems(w, dt, p, exponential, coupled)
    driving_modes(w, p, SCHMID, CONJUGATE_SCHMID, DRIVING, NM)
    return error


@kernel
def _force_change(w: FloatArray, p: FloatArray) -> None:
    """D_S = C : (Feᵀ·D_FE), then ONE = D_FE·S + Fe·D_S, along the modes."""
    left(w, ONE, FE, True, D_FE, False, NM)
    cubic(w, D_S, ONE, p, NM)
    right(w, ONE, D_FE, False, STRESS, False, NM)
    left(w, TWO, FE, False, D_S, False, NM)
    add(w, ONE, TWO, 1.0, NM)


@kernel
def _condense(w: FloatArray, p: FloatArray, coupled: bool) -> None:
    symmetric = p[P_A1] == 0.0 and not coupled
    for i in range(NM):
        if symmetric:
            for s in range(NS):
                w[WEIGHTED + s] = w[SCHMID + i * NS + s] * w[WEIGHT + s]
            project(w, SLIP_STIFFNESS + NM * i, WEIGHTED)
        else:
            weigh_mode(w, (DRIVING if p[P_A1] != 0.0 else SCHMID) + i * NS, coupled)
            project(w, SCRATCH_MODES, WEIGHTED)
            for k in range(NM):
                w[SLIP_STIFFNESS + NM * k + i] = w[SCRATCH_MODES + k]
    left(w, D_FE, TRIAL, False, UNIT, False, NM)
    _force_change(w, p)
    left(w, TWO, TRIAL, True, ONE, False, NM)
    to_modes(w, SOFTENING, TWO, NM)
    over_modes(w, FACTOR, SLIP_STIFFNESS, SOFTENING, NM)
    for k in range(NM):
        w[FACTOR + (NM + 1) * k] += 1.0
    # No pivoting: in these modes Y is near the diagonal of the elastic constants (near 0 for the
    # spins) and H is positive, so that the pivots are ≥ 1 or close to it.
    factor(w, FACTOR, NM)


@kernel
def condensed_change(w: FloatArray, p: FloatArray) -> None:
    """D_MODES = (I + H·Y)⁻¹ Σ LOAD m⊗n, then D_TAU = −(m⊗n) : Y D_MODES."""
    project(w, D_MODES, LOAD)
    solve(w, FACTOR, NM, D_MODES, 1)
    over_modes(w, FORCE, SOFTENING, D_MODES, 1)
    for k in range(NM):
        w[FORCE + k] = -w[FORCE + k]
    drive(w, p, FORCE, D_TAU)


@kernel
def update(
    w: FloatArray,
    H: FloatArray,
    R: FloatArray,
    p: FloatArray,
    skin: float,
    dt: float,
    exponential: bool,
    coupled: bool,
    state0: FloatArray,
    guess: FloatArray,
    end: FloatArray,
    tolerance: float,
    most: int,
) -> int:
    """Solve a step at one point; returns the iterations, negative if there is no solution.

    H: displacement gradient ∂u/∂X·R (9); R: crystal → specimen rotation (9); guess: S Δp
    (NS); end: where most is 0 and the guess the solution, the state at the end, else unread.
    """
    load_point(w, state0, p, skin, dt, exponential, guess, most == 0, end)
    for i in range(9):
        w[FT + i] = R[i] + H[i]
        w[FP0 + i] = state0[i]
    left(w, TRIAL, FT, False, FP0, False, 1)
    count = 0
    while True:
        error = _evaluate(w, p, dt, exponential, coupled)
        _condense(w, p, coupled)
        if error <= tolerance or count >= most or not is_sound(w, error):
            break
        condensed_change(w, p)
        advance_slips(w, p, dt, exponential, coupled)
        count += 1
    # An element that is turned inside out has no meaning, though its equations may have a solution.
    valid = error <= tolerance and is_sound(w, error) and determinant_of(w, FT) > 0.0
    return count if valid else -max(count, 1)


@kernel
def store(
    w: FloatArray,
    state1: FloatArray,
    slips: FloatArray,
    P: FloatArray,
) -> None:
    """First Piola–Kirchhoff stress times R (9) and the state at the end of the step."""
    left(w, ONE, FES, False, GAIN, True, 1)
    left(w, TWO, ONE, False, FP0, True, 1)
    for i in range(9):
        P[i] = w[TWO + i]
    left(w, FP1, FP0, False, GAIN, False, 1)
    scale = determinant_of(w, FP1) ** (-1.0 / 3.0)
    for i in range(9):
        state1[i] = w[FP1 + i] * scale
    store_slips(w, state1, slips)


@kernel
def modes_along_gradient(w: FloatArray, p: FloatArray) -> None:
    """D_MODES (8, 9): change of A for each component of H; also T_BY_H and FIXED_BY_H.

    FP1 is that of the slips. F·FP0 and F·FP1 change by one row, which is one of FP0 or of FP1.
    """
    for a in range(3):
        for b in range(3):
            for row in range(3):
                for column in range(3):
                    w[ONE + 9 * (3 * a + b) + 3 * row + column] = (
                        w[FE + 3 * row + a] * w[FP1 + 3 * column + b]
                    )
    cubic(w, D_S, ONE, p, 9)
    left(w, ONE, FE, False, D_S, False, 9)
    right(w, TWO, FP1, False, STRESS, False, 1)
    for row in range(3):
        for b in range(3):
            for column in range(3):
                w[ONE + 9 * (3 * row + b) + 3 * row + column] += w[TWO + 3 * column + b]
    left(w, D_T, TRIAL, True, ONE, False, 9)
    for a in range(3):
        for b in range(3):
            for row in range(3):
                for column in range(3):
                    w[D_T + 9 * (3 * a + b) + 3 * row + column] += (
                        w[FP0 + 3 * column + a] * w[FES + 3 * row + b]
                    )
    right(w, FIXED_BY_H, ONE, False, FP1, True, 9)
    to_modes(w, T_BY_H, D_T, 9)
    over_modes(w, D_MODES, SLIP_STIFFNESS, T_BY_H, 9)
    solve(w, FACTOR, NM, D_MODES, 9)


@kernel
def stress_along_gradient(w: FloatArray, target: int) -> None:
    """∂P/∂H (9, 9) from what `modes_along_gradient` leaves.

    P and −T are derivatives of the same energy, by F and by A: ∂P/∂A is −∂T/∂H transposed.
    """
    for i in range(9):
        t = T_BY_H + i
        t0, t1, t2, t3 = w[t], w[t + 9], w[t + 18], w[t + 27]
        t4, t5, t6, t7 = w[t + 36], w[t + 45], w[t + 54], w[t + 63]
        for j in range(9):
            w[target + 9 * i + j] = w[FIXED_BY_H + 9 * i + j] - (
                t0 * w[D_MODES + j]
                + t1 * w[D_MODES + 9 + j]
                + t2 * w[D_MODES + 18 + j]
                + t3 * w[D_MODES + 27 + j]
                + t4 * w[D_MODES + 36 + j]
                + t5 * w[D_MODES + 45 + j]
                + t6 * w[D_MODES + 54 + j]
                + t7 * w[D_MODES + 63 + j]
            )


@kernel
def tangent(w: FloatArray, p: FloatArray, C: FloatArray) -> None:
    """Consistent tangent ∂P/∂H (9, 9), after `store`."""
    modes_along_gradient(w, p)
    stress_along_gradient(w, TWO)
    for i in range(9):
        for j in range(9):
            C[i, j] = w[TWO + 9 * i + j]
