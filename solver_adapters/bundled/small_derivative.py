"""Directional derivatives of a solved step at a Gauss point in small strain.

A direction changes the trial modes by V·dH + dV·H − dep⁰ and puts a load Σ LOAD P on the
condensed system; `response` prepares its inverse.
"""

import numpy as np
from numpy.typing import NDArray

from solver_adapters.bundled.compilation import kernel
from solver_adapters.bundled.dense import solve
from solver_adapters.bundled.law import NS, P_A1, P_C11, P_C12, P_C44
from solver_adapters.bundled.law_terms import non_schmid_derivative
from solver_adapters.bundled.slip import weigh_residual
from solver_adapters.bundled.slip_derivatives import (
    explicit_derivative,
    finish_derivative,
    slip_change,
    total_slip_change,
)
from solver_adapters.bundled.slip_rows import D_TAU, EXPLICIT, LOAD, OTHER, SIGN, STEP
from solver_adapters.bundled.small_strain import (
    CHANGE,
    CONJUGATE_SCHMID,
    D_STRESS,
    D_TRIAL,
    ELASTIC,
    FACTOR,
    INVERSE,
    ROWS,
    SCRATCH_MODES,
    STRESS,
    VOLUME,
    add_stress,
    drive,
    project,
    resolve,
    strain_modes,
)

FloatArray = NDArray[np.float64]


@kernel
def response(
    w: FloatArray,
    V: FloatArray,
    p: FloatArray,
    coupled: bool,
    by_slip: FloatArray,
    by_state: FloatArray,
) -> None:
    """How slips (9, 24) and kinematic state (9, 9) of the step in the workspace follow H."""
    for k in range(25):
        w[ROWS + k] = 0.0
    for k in range(5):
        w[ROWS + 6 * k] = 1.0
    solve(w, FACTOR, 5, ROWS, 5)
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
        for k in range(5, 9):
            by_state[j, k] = 0.0
        drive(w, p, CHANGE, D_TAU)
        slip_change(w, coupled)
        for s in range(NS):
            by_slip[j, s] = w[STEP + s]


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
def derivative(
    w: FloatArray,
    H: FloatArray,
    V: FloatArray,
    p: FloatArray,
    skin: float,
    dt: float,
    exponential: bool,
    coupled: bool,
    constant: bool,
    dH: FloatArray,
    turned: bool,
    dV: FloatArray,
    dp: FloatArray,
    dskin: float,
    dstate0: FloatArray,
    gains: FloatArray,
    dP: FloatArray,
    dstate1: FloatArray,
) -> None:
    """Directional derivative of stress and state of the step that is in the workspace.

    constant: whether dp and dskin are null; turned: whether the crystal turns along the direction,
    that is, whether dV is not null; gains: of `slip_derivatives.slip_gains`.
    """
    mu0 = p[P_C11] - p[P_C12]
    mu1 = 2.0 * p[P_C44]
    dmu0 = dp[P_C11] - dp[P_C12]
    dmu1 = 2.0 * dp[P_C44]
    strain_modes(w, D_TRIAL, V, dH)
    if turned:
        strain_modes(w, SCRATCH_MODES, dV, H)
        for k in range(6):
            w[D_TRIAL + k] += w[SCRATCH_MODES + k]
    dvolume = w[D_TRIAL + 5]
    for k in range(5):
        de = w[D_TRIAL + k]
        w[D_STRESS + k] = (mu0 if k < 2 else mu1) * (de - dstate0[k]) + (
            dmu0 if k < 2 else dmu1
        ) * w[ELASTIC + k]
    drive(w, p, D_STRESS, EXPLICIT)
    for s in range(NS):
        w[EXPLICIT + s] *= w[SIGN + s]
    if dp[P_A1] != 0.0:
        resolve(w, CONJUGATE_SCHMID, STRESS, OTHER)
        non_schmid_derivative(w, p, dp)
    explicit_derivative(w, dt, p, skin, exponential, coupled, constant, dp, dskin, dstate0)
    weigh_residual(w, EXPLICIT, coupled)
    project(w, SCRATCH_MODES, LOAD)
    _invert(w, SCRATCH_MODES, CHANGE)
    for k in range(5):
        w[CHANGE + k] = -w[CHANGE + k]
    drive(w, p, CHANGE, D_TAU)
    total_slip_change(w, coupled)
    finish_derivative(w, p, exponential, dp, gains, dstate0, dstate1)
    bulk = p[P_C11] + 2.0 * p[P_C12]
    dbulk = dp[P_C11] + 2.0 * dp[P_C12]
    dsigma_volume = bulk * dvolume + dbulk * w[VOLUME]
    for k in range(5):
        mu = mu0 if k < 2 else mu1
        dmu = dmu0 if k < 2 else dmu1
        dsigma = w[D_STRESS + k] + w[CHANGE + k]
        dstate1[k] = w[D_TRIAL + k] - (dsigma - dmu * w[ELASTIC + k]) / mu
        w[D_STRESS + k] = dsigma
    for k in range(5, 9):
        dstate1[k] = 0.0
    for i in range(9):
        dP[i] = 0.0
    add_stress(dP, V, w, D_STRESS, dsigma_volume)
    if turned:
        add_stress(dP, dV, w, STRESS, bulk * w[VOLUME])
