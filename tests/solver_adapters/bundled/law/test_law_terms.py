"""The terms beyond the baseline on a workspace filled by hand, against their formulas."""

from __future__ import annotations

import numpy as np
import pytest

from solver_adapters.bundled.law import NS, law_terms
from solver_adapters.bundled.law import workspace_layout as rows
from solver_adapters.bundled.law.law import (
    FIRST_112,
    P_A1,
    P_B,
    P_C2,
    P_D2,
    P_LATENT,
    P_Q,
    system_modes,
)
from solver_adapters.crystal import BCC
from tests.solver_adapters.bundled.from_python import FromPython
from tests.solver_adapters.bundled.slip_workspace import (
    ACCUMULATED,
    COUPLED,
    OTHER,
    RNG,
    SCHEMES,
    SECOND,
    SIGN,
    SLIP,
    STEP,
    TAU,
    by_constant,
    constants,
    hardening,
    moduli,
    row,
    second,
    second_left,
    workspace,
)

kernels = FromPython(law_terms)

MODES = system_modes(BCC)


@COUPLED
def test_hardening_and_its_slopes(coupled: bool) -> None:
    w, p = workspace(coupled), constants(coupled)
    kernels.harden(w, p, coupled)
    total = ACCUMULATED + SLIP
    np.testing.assert_allclose(row(w, rows.RISE), hardening(p, total, coupled), rtol=1e-13)
    slopes = moduli(p, coupled) * p[P_B] * np.exp(-p[P_B] * total)
    np.testing.assert_allclose(row(w, rows.SLOPE), np.diag(slopes), rtol=1e-13)
    if coupled:
        found = w[rows.COUPLED : rows.COUPLED + NS * NS].reshape(NS, NS)
        np.testing.assert_allclose(found, slopes, rtol=1e-13)


@COUPLED
@pytest.mark.parametrize("name", ["Q", "b", "latent"])
def test_the_derivative_of_hardening_is_that_of_the_complex_step(name: str, coupled: bool) -> None:
    w, p = workspace(coupled), constants(coupled)
    turned = p.astype(complex)
    row(w, rows.UNHARDENED)[:] = np.exp(-p[P_B] * (ACCUMULATED + SLIP))
    index = {"Q": P_Q, "b": P_B, "latent": P_LATENT}[name]
    turned[index] += 1j * STEP
    if name == "b":
        kernels.hardening_by_b(w, p, coupled)
    else:
        (kernels.hardening_by_q if name == "Q" else kernels.hardening_by_latent)(w)
    expected = -hardening(turned, ACCUMULATED + SLIP, coupled).imag / STEP
    np.testing.assert_allclose(by_constant(w, index), expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("index", [P_Q, P_LATENT], ids=["Q", "latent"])
def test_the_first_hardening_of_a_law_without_any_is_felt_by_all_systems(index: int) -> None:
    """Without any points count as uncoupled, but the derivative is that of their matrix."""
    w, p = workspace(), constants()
    p[[P_Q, P_LATENT]] = 0.0
    row(w, rows.UNHARDENED)[:] = np.exp(-p[P_B] * (ACCUMULATED + SLIP))
    (kernels.hardening_by_q if index == P_Q else kernels.hardening_by_latent)(w)
    p[index] = 1.0
    expected = -hardening(p, ACCUMULATED + SLIP, True)
    np.testing.assert_allclose(by_constant(w, index), expected, rtol=1e-13)


@SCHEMES
def test_the_second_back_stress_resists_moving_systems_and_shifts_those_at_rest(
    exponential: bool,
) -> None:
    w, p = workspace(), constants()
    row(w, rows.RISE)[:] = 3.0
    kernels.second_back_stress(w, p, exponential)
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
@pytest.mark.parametrize("name", ["c2", "d2"])
def test_the_derivative_of_the_second_back_stress_is_that_of_the_complex_step(
    name: str, exponential: bool
) -> None:
    w, p = workspace(), constants()
    turned = p.astype(complex)
    index = {"c2": P_C2, "d2": P_D2}[name]
    turned[index] += 1j * STEP
    row(w, rows.LEFT2)[:] = second_left(p, exponential)
    if name == "c2":
        kernels.second_back_stress_by_c2(w, p, exponential)
    else:
        kernels.second_back_stress_by_d2(w, p, exponential)
    expected = -(turned[P_C2] * second(turned, SIGN * SECOND, exponential)).imag / STEP
    found = by_constant(w, index)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * abs(expected).max())


def test_non_schmid_stress_drives_110_as_its_tensors_do_and_leaves_112_alone() -> None:
    """S τ (1 + a1/2) + a1 τ' is the product of the stress with the driving tensors along S."""
    w, p = workspace(), constants()
    schmid = rows.N_SLIP_ROWS
    conjugate, driving = schmid + 5 * NS, schmid + 10 * NS
    w[schmid:conjugate], w[conjugate:driving] = (
        MODES.schmid[:5].ravel(),
        MODES.conjugate[:5].ravel(),
    )
    stress = RNG.normal(size=5)
    row(w, rows.TAU)[:] = stress @ MODES.schmid[:5]
    row(w, rows.OTHER)[:] = stress @ MODES.conjugate[:5]
    tau, other = row(w, rows.TAU).copy(), row(w, rows.OTHER).copy()
    kernels.driving_modes(w, p, schmid, conjugate, driving, 5)
    kernels.non_schmid(w, p)
    driven = SIGN * row(w, rows.TAU) - row(w, rows.RISE)
    np.testing.assert_allclose(SIGN * (stress @ w[driving:].reshape(5, NS)), driven, atol=1e-14)
    factor = np.where(np.arange(NS) < FIRST_112, 1.0 + 0.5 * p[P_A1], 1.0)
    np.testing.assert_allclose(driven, SIGN * factor * tau + p[P_A1] * other, atol=1e-14)
    np.testing.assert_array_equal(row(w, rows.TAU)[FIRST_112:], tau[FIRST_112:])


def test_the_derivative_along_a1_is_linear_in_the_stresses() -> None:
    w, p = workspace(), constants()
    kernels.non_schmid(w, p)
    kernels.non_schmid_by_a1(w, p)
    expected = np.where(np.arange(NS) < FIRST_112, 0.5 * SIGN * TAU + OTHER, 0.0)
    np.testing.assert_allclose(by_constant(w, P_A1), expected, atol=1e-13)
