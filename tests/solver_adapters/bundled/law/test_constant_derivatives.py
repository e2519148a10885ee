"""What directions owe to the constants of the law, against the complex step of the formulas.

The derivatives of whole points are those of `test_gauss_points`.
"""

from __future__ import annotations

import numpy as np
import pytest

from meshes.arrays import BoolArray, FloatArray
from solver_adapters.bundled.law import NS, constant_derivatives
from solver_adapters.bundled.law import workspace_layout as rows
from solver_adapters.bundled.law.law import (
    FIRST_112,
    FIRST_123,
    N_LOCAL,
    P_ASYMMETRY,
    P_C,
    P_C11,
    P_C12,
    P_C44,
    P_D,
    P_D2,
    P_K,
    P_N,
    P_TAU110,
    P_TAU112,
    P_TAU123,
)
from solver_adapters.bundled.law.simd_rows import B_EXPLICIT, B_OVER, B_SLIP_END, LANES
from solver_adapters.bundled.law.state_layout import N_STATE, S_ACC, S_X, S_X2
from tests.solver_adapters.bundled.from_python import FromPython
from tests.solver_adapters.bundled.slip_workspace import (
    RNG,
    SCHEMES,
    SECOND,
    SIGN,
    SLIP,
    STEP,
    by_constant,
    constants,
    row,
    second,
    second_left,
    workspace,
)

kernels = FromPython(constant_derivatives)

DT, SKIN = 0.7, 1.3
FIRST, WIDTH = 2, 5
MOVING = np.flatnonzero(SLIP > 0.0)
FAMILY = np.digitize(np.arange(NS), [FIRST_112, FIRST_123])


def law() -> FloatArray:
    p = constants()
    p[[P_K, P_N, P_C, P_D]] = 120.0, 11.0, 4.4e4, 1140.0
    p[[P_TAU110, P_TAU112, P_TAU123, P_ASYMMETRY]] = 21.0, 24.0, 26.0, 0.9
    return p


def asked(*which: int) -> BoolArray:
    return np.isin(np.arange(N_LOCAL), which)


def lanes(b: FloatArray, offset: int) -> FloatArray:
    return b[offset : offset + LANES * MOVING.size].reshape(-1, LANES)[:, :WIDTH]


def test_the_initial_resistance_of_each_family_and_its_asymmetry_resist_slip() -> None:
    w, p = workspace(), law()
    row(w, rows.SENSE)[:] = RNG.choice([-1.0, 1.0], NS)
    # Each is asked for alone: what others ask for may not be what makes its row.
    for family, constant in enumerate((P_TAU110, P_TAU112, P_TAU123)):
        by_constant(w, constant)[:] = np.nan
        kernels.constant_rows(w, DT, p, SKIN, False, True, asked(constant))
        expected = np.where(family == FAMILY, -SKIN, 0.0)
        np.testing.assert_array_equal(by_constant(w, constant), expected)
    kernels.constant_rows(w, DT, p, SKIN, False, True, asked(P_ASYMMETRY))
    found = by_constant(w, P_ASYMMETRY)
    np.testing.assert_array_equal(found, SKIN * SIGN * row(w, rows.SENSE))


@pytest.mark.parametrize("constant", [P_K, P_N], ids=["K", "n"])
def test_the_overstress_follows_k_and_n_as_the_complex_step_says(constant: int) -> None:
    w, p = workspace(), law()
    turned = p.astype(complex)
    turned[constant] += 1j * STEP
    g = np.maximum(SLIP, 1e-30)
    over = turned[P_K] * (g / DT) ** (1.0 / turned[P_N])
    row(w, rows.VISCOUS)[:] = over.real
    kernels.constant_rows(w, DT, p, SKIN, False, True, asked(constant))
    np.testing.assert_allclose(by_constant(w, constant), -over.imag / STEP, rtol=1e-9)


def test_constants_reach_their_directions_alone_and_the_overstress_through_k_and_n() -> None:
    """Direction 3 changes c and n, 5 tau0 of {110}, 6 K; those without changes stay."""
    w, p = workspace(), law()
    for offset in (rows.XHAT, rows.RECALL, rows.VISCOUS):
        row(w, offset)[:] = RNG.normal(size=NS)
    dp = np.zeros((FIRST + WIDTH + 1, N_LOCAL))
    dp[3, [P_C, P_N]], dp[5, P_TAU110], dp[6, P_K] = (2.0, -0.4), 0.6, 3.0
    dp[4, [P_C11, P_C44]] = 1.0  # of elasticity: not by slip
    changes = dp.any(axis=1)
    kernels.constant_rows(w, DT, p, SKIN, False, True, dp.any(axis=0))
    before = RNG.normal(size=B_SLIP_END)
    b = before.copy()
    kernels.constant_derivatives(w, b, MOVING, MOVING.size, changes, dp, FIRST, WIDTH)
    added, over = lanes(b, B_EXPLICIT) - lanes(before, B_EXPLICIT), lanes(b - before, B_OVER)
    by_n, by_K = -0.4 * by_constant(w, P_N)[MOVING], 3.0 * by_constant(w, P_K)[MOVING]
    expected = np.zeros((MOVING.size, WIDTH))
    expected[:, 1] = by_n - 2.0 * row(w, rows.XHAT)[MOVING]
    expected[:, 3] = np.where(FAMILY[MOVING] == 0, -0.6 * SKIN, 0.0)
    expected[:, 4] = by_K
    np.testing.assert_allclose(added, expected, rtol=1e-12, atol=1e-14)
    expected = np.zeros((MOVING.size, WIDTH))
    expected[:, 1], expected[:, 4] = -by_n, -by_K
    np.testing.assert_allclose(over, expected, rtol=1e-12, atol=1e-14)


def test_a_factor_on_tau0_acts_on_the_resistance_of_the_baseline() -> None:
    w, p = workspace(), law()
    row(w, rows.SENSE)[:] = RNG.choice([-1.0, 1.0], NS)
    skinned = np.array([1, 1, 0, 2, 0, 1, 0, 2])
    dskin = np.zeros((3, 4))
    dskin[1:, 2] = 0.5, -0.25
    before = RNG.normal(size=B_SLIP_END)
    b = before.copy()
    given = (MOVING, MOVING.size, 2, skinned, dskin, FIRST, WIDTH)
    kernels.factor_derivatives(w, b, p, *given)
    tau0 = p[[P_TAU110, P_TAU112, P_TAU123]][FAMILY]
    resistance = (tau0 - SIGN * p[P_ASYMMETRY] * row(w, rows.SENSE))[MOVING]
    changes = dskin[skinned[FIRST : FIRST + WIDTH], 2]
    found = lanes(b, B_EXPLICIT) - lanes(before, B_EXPLICIT)
    np.testing.assert_allclose(found, -resistance[:, None] * changes, rtol=1e-12, atol=1e-14)


@SCHEMES
@pytest.mark.parametrize("rows_kept", [S_ACC, N_STATE])
def test_the_recall_of_both_back_strains_is_that_of_the_complex_step(
    exponential: bool, rows_kept: int
) -> None:
    w, p, turned = workspace(), law(), law().astype(complex)
    row(w, rows.RECALL)[:] = RNG.normal(size=NS)
    row(w, rows.LEFT2)[:] = second_left(p, exponential)
    dp = np.zeros((2, N_LOCAL))
    dp[1, [P_D, P_D2]] = 0.3, 0.7
    turned[P_D2] += 0.7j * STEP
    dstate = RNG.normal(size=(rows_kept, 2))
    expected = dstate.copy()
    expected[S_X + MOVING, 1] += 0.3 * (SIGN * row(w, rows.RECALL))[MOVING]
    if rows_kept > S_X2:
        end = SIGN * second(turned, SIGN * SECOND, exponential)
        expected[S_X2 + MOVING, 1] += end.imag[MOVING] / STEP
    for k in range(2):
        kernels.advance_constants(w, p, exponential, dp, MOVING, MOVING.size, dstate, k)
    np.testing.assert_allclose(dstate, expected, rtol=1e-8, atol=1e-12)


def test_only_constants_of_elasticity_are_elastic() -> None:
    dp = np.eye(N_LOCAL)
    found = [bool(kernels.elastic(dp, k)) for k in range(N_LOCAL)]
    assert found == [k in (P_C11, P_C12, P_C44) for k in range(N_LOCAL)]
