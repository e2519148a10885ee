"""The terms beyond the baseline on a workspace filled by hand, against their formulas."""

from __future__ import annotations

import numpy as np
import pytest

from solver_adapters.bundled import law_terms
from solver_adapters.bundled import slip_rows as rows
from solver_adapters.bundled.law import (
    CONJUGATE_MODES,
    FIRST_112,
    N_LOCAL,
    N_STATE,
    NS,
    P_A1,
    P_B,
    P_C2,
    P_D2,
    P_LATENT,
    P_Q,
    S_ACC,
    S_X2,
    SCHMID_MODES,
)
from solver_adapters.interface import FloatArray

STEP = 1e-30
RNG = np.random.default_rng(7)
SIGN = RNG.choice([-1.0, 1.0], NS)
SLIP = np.where(RNG.random(NS) < 0.6, 10.0 ** RNG.uniform(-6.0, -2.0, NS), 0.0)
ACCUMULATED = RNG.uniform(0.0, 2e-2, NS)
SECOND = RNG.uniform(-2e-3, 2e-3, NS)
TAU, OTHER = RNG.uniform(-90.0, 90.0, NS), RNG.uniform(-40.0, 40.0, NS)
H = RNG.uniform(0.2, 1.8, (NS, NS))

COUPLED = pytest.mark.parametrize("coupled", [True, False])
SCHEMES = pytest.mark.parametrize("exponential", [True, False], ids=["exponential", "Euler"])


def row(w: FloatArray, offset: int) -> FloatArray:
    return w[offset : offset + NS]


def workspace(coupled: bool = True) -> FloatArray:
    w = np.zeros(rows.N_SLIP_ROWS + 3 * 5 * NS)
    given = {
        rows.SIGN: SIGN, rows.SLIP: SLIP, rows.ACC0: ACCUMULATED, rows.X20: SECOND,
        rows.TAU: TAU, rows.OTHER: OTHER,
    }  # fmt: skip
    for offset, values in given.items():
        row(w, offset)[:] = values
    w[rows.INTERACTION : rows.INTERACTION + NS * NS] = (H if coupled else np.eye(NS)).ravel()
    return w


def constants(coupled: bool = True) -> FloatArray:
    p = np.zeros(N_LOCAL)
    p[[P_Q, P_B, P_C2, P_D2, P_A1]] = 15.0, 40.0, 4000.0, 120.0, 0.3
    p[P_LATENT] = 6.0 if coupled else 0.0
    return p


def moduli(p: FloatArray, coupled: bool) -> FloatArray:
    """Q h and the latent hardening beside its diagonal; alone systems have the identity for h."""
    h = H if coupled else np.eye(NS)
    return np.asarray(p[P_Q] * h + p[P_LATENT] * (1.0 - np.eye(NS)))


def hardening(p: FloatArray, total: FloatArray, coupled: bool) -> FloatArray:
    """Σ_r M_sr (1 − exp(−b p_r)), complex numbers included."""
    return np.asarray(moduli(p, coupled) @ (1.0 - np.exp(-p[P_B] * total)))


def second(p: FloatArray, start: FloatArray, exponential: bool) -> FloatArray:
    """S x2 at the end of the step from S x2 at its start."""
    d, g = p[P_D2], SLIP
    if not exponential:
        return np.asarray((start + g) / (1.0 + d * g))
    return np.asarray(1.0 / d + (start - 1.0 / d) * np.exp(-d * g))


@COUPLED
def test_hardening_and_its_slopes(coupled: bool) -> None:
    w, p = workspace(coupled), constants(coupled)
    law_terms.harden(w, p, coupled)
    total = ACCUMULATED + SLIP
    np.testing.assert_allclose(row(w, rows.RISE), hardening(p, total, coupled), rtol=1e-13)
    slopes = moduli(p, coupled) * p[P_B] * np.exp(-p[P_B] * total)
    np.testing.assert_allclose(row(w, rows.SLOPE), np.diag(slopes), rtol=1e-13)
    if coupled:
        found = w[rows.COUPLED : rows.COUPLED + NS * NS].reshape(NS, NS)
        np.testing.assert_allclose(found, slopes, rtol=1e-13)


@COUPLED
@pytest.mark.parametrize("name", ["Q", "b", "latent", "history"])
def test_the_derivative_of_hardening_is_that_of_the_complex_step(name: str, coupled: bool) -> None:
    w, p = workspace(coupled), constants(coupled)
    dp, dstate = np.zeros(N_LOCAL), np.zeros(N_STATE)
    row(w, rows.UNHARDENED)[:] = np.exp(-p[P_B] * (ACCUMULATED + SLIP))
    rate = RNG.normal(size=NS)
    total, turned = (ACCUMULATED + SLIP).astype(complex), p.astype(complex)
    if name == "history":
        dstate[S_ACC : S_ACC + NS] = rate
        total += 1j * STEP * rate
    else:
        index = {"Q": P_Q, "b": P_B, "latent": P_LATENT}[name]
        dp[index] = 0.7
        turned[index] += 1j * STEP * 0.7
    law_terms.hardening_derivative(w, p, coupled, dp, dstate)
    expected = -hardening(turned, total, coupled).imag / STEP
    np.testing.assert_allclose(row(w, rows.EXPLICIT), expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("index", [P_Q, P_LATENT], ids=["Q", "latent"])
def test_the_first_hardening_of_a_law_without_any_is_felt_by_all_systems(index: int) -> None:
    """Without any points count as uncoupled, but the derivative is that of their matrix."""
    w, p, dp = workspace(), constants(), np.zeros(N_LOCAL)
    p[[P_Q, P_LATENT]], dp[index] = 0.0, 1.0
    row(w, rows.UNHARDENED)[:] = np.exp(-p[P_B] * (ACCUMULATED + SLIP))
    law_terms.hardening_derivative(w, p, False, dp, np.zeros(N_STATE))
    p[index] = 1.0
    expected = -hardening(p, ACCUMULATED + SLIP, True)
    np.testing.assert_allclose(row(w, rows.EXPLICIT), expected, rtol=1e-13)


@SCHEMES
def test_the_second_back_stress_resists_moving_systems_and_shifts_those_at_rest(
    exponential: bool,
) -> None:
    w, p = workspace(), constants()
    row(w, rows.RISE)[:] = 3.0
    law_terms.second_back_stress(w, p, exponential)
    moves, end = SLIP > 0.0, second(p, SIGN * SECOND, exponential)
    np.testing.assert_allclose(row(w, rows.X2HAT), end, rtol=1e-12)
    expected = 3.0 + np.where(moves, p[P_C2] * end, 0.0)
    np.testing.assert_allclose(row(w, rows.RISE), expected, rtol=1e-12)
    np.testing.assert_allclose(row(w, rows.SHIFT), np.where(moves, 0.0, p[P_C2] * SECOND))
    # dx = dp − d x dp of the exact path; Euler's end has the slope (1 − d x⁰)/(1 + d Δp)².
    left = np.exp(-p[P_D2] * SLIP) if exponential else (1.0 + p[P_D2] * SLIP) ** -2
    slope = p[P_C2] * (1.0 - p[P_D2] * SIGN * SECOND) * left
    np.testing.assert_allclose(row(w, rows.SLOPE), np.where(moves, slope, 0.0), rtol=1e-12)


@SCHEMES
@pytest.mark.parametrize("name", ["c2", "d2", "history"])
def test_the_derivative_of_the_second_back_stress_is_that_of_the_complex_step(
    name: str, exponential: bool
) -> None:
    w, p, dp, dstate = workspace(), constants(), np.zeros(N_LOCAL), np.zeros(N_STATE)
    rate = RNG.normal(size=NS)
    start, turned = (SIGN * SECOND).astype(complex), p.astype(complex)
    if name == "history":
        dstate[S_X2 : S_X2 + NS] = rate
        start += 1j * STEP * SIGN * rate
    else:
        index = {"c2": P_C2, "d2": P_D2}[name]
        dp[index] = 0.7
        turned[index] += 1j * STEP * 0.7
    law_terms.second_back_stress_derivative(w, p, exponential, dp, dstate)
    expected = -(turned[P_C2] * second(turned, start, exponential)).imag / STEP
    found = row(w, rows.EXPLICIT)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * abs(expected).max())


def test_non_schmid_stress_drives_110_as_its_tensors_do_and_leaves_112_alone() -> None:
    """S τ (1 + a1/2) + a1 τ' is the product of the stress with the driving tensors along S."""
    w, p = workspace(), constants()
    schmid = rows.N_SLIP_ROWS
    conjugate, driving = schmid + 5 * NS, schmid + 10 * NS
    w[schmid:conjugate], w[conjugate:driving] = (
        SCHMID_MODES[:5].ravel(),
        CONJUGATE_MODES[:5].ravel(),
    )
    stress = RNG.normal(size=5)
    row(w, rows.TAU)[:] = stress @ SCHMID_MODES[:5]
    row(w, rows.OTHER)[:] = stress @ CONJUGATE_MODES[:5]
    tau, other = row(w, rows.TAU).copy(), row(w, rows.OTHER).copy()
    law_terms.driving_modes(w, p, schmid, conjugate, driving, 5)
    law_terms.non_schmid(w, p)
    driven = SIGN * row(w, rows.TAU) - row(w, rows.RISE)
    np.testing.assert_allclose(SIGN * (stress @ w[driving:].reshape(5, NS)), driven, atol=1e-14)
    factor = np.where(np.arange(NS) < FIRST_112, 1.0 + 0.5 * p[P_A1], 1.0)
    np.testing.assert_allclose(driven, SIGN * factor * tau + p[P_A1] * other, atol=1e-14)
    np.testing.assert_array_equal(row(w, rows.TAU)[FIRST_112:], tau[FIRST_112:])


def test_the_derivative_along_a1_is_linear_in_the_stresses() -> None:
    w, p, dp = workspace(), constants(), np.zeros(N_LOCAL)
    dp[P_A1] = 0.7
    law_terms.non_schmid(w, p)
    law_terms.non_schmid_derivative(w, p, dp)
    expected = np.where(np.arange(NS) < FIRST_112, 0.7 * (0.5 * SIGN * TAU + OTHER), 0.0)
    np.testing.assert_allclose(row(w, rows.EXPLICIT), expected, atol=1e-13)
