"""Crystal law at a Gauss point in small strain.

Steps of an update (modes: the orthonormal tensors in which cubic elasticity is diagonal):
1. trial modes e* = V·H − ep⁰, V the modes turned into the specimen, H the displacement gradient;
2. stress modes σ = μ (e* − Σ S Δp P), resolved shear stresses τ = P·σ;
3. their residuals, linearised in Δp and condensed to (1/μ + Σ w P Pᵀ) δσ = −Σ S w f P (5 × 5);
4. slips updated from δσ; 2–4 repeated until the residuals ask for no more slip;
5. consistent tangent (1/μ + Σ w P Pᵀ)⁻¹ in the same modes.
With a non-Schmid term the second P is that of the driving stress; with latent hardening w is a
matrix. Both make the condensed system unsymmetric.
"""

from meshes.arrays import FloatArray
from solver_adapters.bundled.law.law import P_A1, P_C11, P_C12, P_C44
from solver_adapters.bundled.law.small_lu import factor, solve, solve_five
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

SCHMID = N_SLIP_ROWS  # modes of the Schmid tensors, 5 × NS
CONJUGATE_SCHMID = SCHMID + 5 * NS  # modes of the conjugate tensors, 5 × NS
DRIVING = CONJUGATE_SCHMID + 5 * NS  # modes of the driving stress, 5 × NS, where it is not Schmid's
TRIAL = DRIVING + 5 * NS  # e* and the trace mode, 6
ELASTIC = TRIAL + 6  # elastic strain modes, 5
STRESS = ELASTIC + 5  # stress modes, 5
FACTOR = STRESS + 5  # LU of 1/μ + Σ w P Pᵀ, 5 × 5
CHANGE = FACTOR + 25  # change of the stress modes, 5
VOLUME = CHANGE + 5  # trace mode of the strain, 1
SCRATCH_MODES = VOLUME + 1  # scratch: modes of a tensor, 6
ROWS = SCRATCH_MODES + 6  # scratch: modes of nine tensors times FACTOR's inverse, 5 × 9
INVERSE = ROWS + 45  # (1/μ + Σ w P Pᵀ)⁻¹, 5 × 5, the second index first
WORKSPACE = INVERSE + 25


@kernel
def prepare(
    w: FloatArray,
    schmid: FloatArray,
    conjugate: FloatArray,
    interaction: FloatArray,
    sense: FloatArray,
) -> None:
    """Put what is constant into a fresh workspace: the first five of modes (8, NS), and tables."""
    prepare_slip(w, interaction, sense)
    for k in range(5):
        for s in range(NS):
            w[SCHMID + k * NS + s] = schmid[k, s]
            w[CONJUGATE_SCHMID + k * NS + s] = conjugate[k, s]


@kernel
def project(w: FloatArray, target: int, source: int) -> None:
    """Sum over the systems in modes: target = Σ source_s P_s."""
    t0 = t1 = t2 = t3 = t4 = 0.0
    for s in range(NS):
        x = w[source + s]
        t0 += w[SCHMID + s] * x
        t1 += w[SCHMID + NS + s] * x
        t2 += w[SCHMID + 2 * NS + s] * x
        t3 += w[SCHMID + 3 * NS + s] * x
        t4 += w[SCHMID + 4 * NS + s] * x
    w[target], w[target + 1], w[target + 2] = t0, t1, t2
    w[target + 3], w[target + 4] = t3, t4


@kernel
def _stress(w: FloatArray, mu0: float, mu1: float) -> None:
    project(w, SCRATCH_MODES, SIGNED)
    for k in range(5):
        e = w[TRIAL + k] - w[SCRATCH_MODES + k]
        w[ELASTIC + k] = e
        w[STRESS + k] = (mu0 if k < 2 else mu1) * e


@kernel
def resolve(w: FloatArray, tensors: int, source: int, target: int) -> None:
    """Over the systems: target_s = source : tensor_s, both in modes."""
    t0, t1, t2 = w[source], w[source + 1], w[source + 2]
    t3, t4 = w[source + 3], w[source + 4]
    for s in range(NS):
        w[target + s] = (
            w[tensors + s] * t0
            + w[tensors + NS + s] * t1
            + w[tensors + 2 * NS + s] * t2
            + w[tensors + 3 * NS + s] * t3
            + w[tensors + 4 * NS + s] * t4
        )


@kernel
def drive(w: FloatArray, p: FloatArray, source: int, target: int) -> None:
    """Change of the driving stress of each system along its sign."""
    if p[P_A1] != 0.0:
        resolve(w, DRIVING, source, target)
    else:
        resolve(w, SCHMID, source, target)


@kernel
def _evaluate(
    w: FloatArray,
    mu0: float,
    mu1: float,
    p: FloatArray,
    dt: float,
    exponential: bool,
    coupled: bool,
) -> float:
    """Residuals at the slips; returns how far from solved they are."""
    _stress(w, mu0, mu1)
    resolve(w, SCHMID, STRESS, TAU)
    error: float
    if p[P_A1] == 0.0:
        error = evaluate_systems(w, dt, p, exponential, coupled)
        return error
    resolve(w, CONJUGATE_SCHMID, STRESS, OTHER)
    error = evaluate_systems(w, dt, p, exponential, coupled)
    driving_modes(w, p, SCHMID, CONJUGATE_SCHMID, DRIVING, 5)
    return error


@kernel
def _weigh(w: FloatArray) -> None:
    """FACTOR = Σ w P Pᵀ; each number of the triangle is summed in the same loop."""
    a00 = a01 = a02 = a03 = a04 = a11 = a12 = a13 = a14 = 0.0
    a22 = a23 = a24 = a33 = a34 = a44 = 0.0
    for s in range(NS):
        weight = w[WEIGHT + s]
        p0, p1, p2 = w[SCHMID + s], w[SCHMID + NS + s], w[SCHMID + 2 * NS + s]
        p3, p4 = w[SCHMID + 3 * NS + s], w[SCHMID + 4 * NS + s]
        w0, w1, w2, w3 = weight * p0, weight * p1, weight * p2, weight * p3
        a00 += w0 * p0
        a01 += w0 * p1
        a02 += w0 * p2
        a03 += w0 * p3
        a04 += w0 * p4
        a11 += w1 * p1
        a12 += w1 * p2
        a13 += w1 * p3
        a14 += w1 * p4
        a22 += w2 * p2
        a23 += w2 * p3
        a24 += w2 * p4
        a33 += w3 * p3
        a34 += w3 * p4
        a44 += weight * p4 * p4
    f = FACTOR
    w[f], w[f + 1], w[f + 2], w[f + 3], w[f + 4] = a00, a01, a02, a03, a04
    w[f + 5], w[f + 6], w[f + 7], w[f + 8], w[f + 9] = a01, a11, a12, a13, a14
    w[f + 10], w[f + 11], w[f + 12], w[f + 13], w[f + 14] = a02, a12, a22, a23, a24
    w[f + 15], w[f + 16], w[f + 17], w[f + 18], w[f + 19] = a03, a13, a23, a33, a34
    w[f + 20], w[f + 21], w[f + 22], w[f + 23], w[f + 24] = a04, a14, a24, a34, a44


@kernel
def _condense(w: FloatArray, mu0: float, mu1: float, p: FloatArray, coupled: bool) -> None:
    if p[P_A1] == 0.0 and not coupled:
        _weigh(w)
    else:
        for i in range(5):
            weigh_mode(w, (DRIVING if p[P_A1] != 0.0 else SCHMID) + i * NS, coupled)
            project(w, SCRATCH_MODES, WEIGHTED)
            for k in range(5):
                w[FACTOR + 5 * k + i] = w[SCRATCH_MODES + k]
    for i in range(5):
        w[FACTOR + 6 * i] += 1.0 / (mu0 if i < 2 else mu1)
    factor(w, FACTOR, 5)


@kernel
def condensed_change(w: FloatArray, p: FloatArray) -> None:
    """CHANGE = −(1/μ + Σ w P Pᵀ)⁻¹ Σ LOAD P, D_TAU = P·CHANGE."""
    project(w, CHANGE, LOAD)
    solve(w, FACTOR, 5, CHANGE, 1)
    for k in range(5):
        w[CHANGE + k] = -w[CHANGE + k]
    drive(w, p, CHANGE, D_TAU)


@kernel
def strain_modes(w: FloatArray, target: int, V: FloatArray, H: FloatArray) -> None:
    """Six modes of the strain of H."""
    t0 = t1 = t2 = t3 = t4 = t5 = 0.0
    for i in range(9):
        h = H[i]
        t0 += V[0, i] * h
        t1 += V[1, i] * h
        t2 += V[2, i] * h
        t3 += V[3, i] * h
        t4 += V[4, i] * h
        t5 += V[5, i] * h
    w[target], w[target + 1], w[target + 2] = t0, t1, t2
    w[target + 3], w[target + 4], w[target + 5] = t3, t4, t5


@kernel
def add_stress(P: FloatArray, V: FloatArray, w: FloatArray, source: int, volume: float) -> None:
    """Add to P the tensor of five modes and a trace mode."""
    s0, s1, s2, s3, s4 = w[source], w[source + 1], w[source + 2], w[source + 3], w[source + 4]
    for i in range(9):
        P[i] += (
            V[0, i] * s0
            + V[1, i] * s1
            + V[2, i] * s2
            + V[3, i] * s3
            + V[4, i] * s4
            + V[5, i] * volume
        )


@kernel
def _trial(w: FloatArray, H: FloatArray, V: FloatArray, state: FloatArray) -> None:
    strain_modes(w, TRIAL, V, H)
    w[VOLUME] = w[TRIAL + 5]
    for k in range(5):
        w[TRIAL + k] -= state[k]


@kernel
def update(
    w: FloatArray,
    H: FloatArray,
    V: FloatArray,
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
    """Solve a step at one point; returns the iterations, negative if it did not converge.

    H: displacement gradient ∂u/∂x·R (9); V: modes times R (6, 9); guess: S Δp
    (NS); end: where most is 0 and the guess the solution, the state at the end, else unread.
    """
    mu0 = p[P_C11] - p[P_C12]
    mu1 = 2.0 * p[P_C44]
    load_point(w, state0, p, skin, dt, exponential, guess, most == 0, end)
    _trial(w, H, V, state0)
    count = 0
    while True:
        error = _evaluate(w, mu0, mu1, p, dt, exponential, coupled)
        _condense(w, mu0, mu1, p, coupled)
        if error <= tolerance or count >= most or not is_sound(w, error):
            break
        condensed_change(w, p)
        advance_slips(w, p, dt, exponential, coupled)
        count += 1
    valid = error <= tolerance and is_sound(w, error)
    return count if valid else -max(count, 1)


@kernel
def store(
    w: FloatArray,
    V: FloatArray,
    p: FloatArray,
    state0: FloatArray,
    state1: FloatArray,
    slips: FloatArray,
    P: FloatArray,
) -> None:
    """Stress σ·R (9) and the state at the end of the step."""
    sigma_volume = (p[P_C11] + 2.0 * p[P_C12]) * w[VOLUME]
    for i in range(9):
        P[i] = 0.0
    add_stress(P, V, w, STRESS, sigma_volume)
    for k in range(5):
        state1[k] = state0[k] + w[TRIAL + k] - w[ELASTIC + k]
    for k in range(5, 9):
        state1[k] = 0.0
    store_slips(w, state1, slips)


@kernel
def tangent(w: FloatArray, V: FloatArray, p: FloatArray, C: FloatArray) -> None:
    """Consistent tangent ∂P/∂H (9, 9)."""
    for k in range(5):
        for i in range(9):
            w[ROWS + 9 * k + i] = V[k, i]
    solve_five(w, FACTOR, ROWS, 9)
    bulk = p[P_C11] + 2.0 * p[P_C12]
    for i in range(9):
        v0, v1, v2, v3, v4 = V[0, i], V[1, i], V[2, i], V[3, i], V[4, i]
        volume = bulk * V[5, i]
        for j in range(9):
            C[i, j] = (
                volume * V[5, j]
                + v0 * w[ROWS + j]
                + v1 * w[ROWS + 9 + j]
                + v2 * w[ROWS + 18 + j]
                + v3 * w[ROWS + 27 + j]
                + v4 * w[ROWS + 36 + j]
            )
