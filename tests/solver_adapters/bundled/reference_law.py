"""One backward Euler step of the crystal law in plain NumPy, written from its equations.

It shares nothing with the kernels but the layout of parameters and state. Every function takes
complex numbers: the imaginary part carries a derivative without cancellation (complex step).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solver_adapters.bundled.law import (
    P_B,
    P_C,
    P_C11,
    P_C12,
    P_C44,
    P_D,
    P_K,
    P_N,
    P_Q,
    P_TAU110,
    P_TAU112,
    S_ACC,
    S_X,
    STRAIN_MODES,
)
from solver_adapters.crystal import schmid_tensors

AnyArray = NDArray[Any]
SCHMID = schmid_tensors()
COMPLEX_STEP = 1e-30


@dataclass(frozen=True, eq=False)
class Step:
    """A step of one point: displacement gradient H (3, 3), crystal rotation R (3, 3), constants
    (11,), state at the start (57,), length dt [s]; whatever is complex is differentiated.
    """

    strain_measure: str
    H: AnyArray
    R: AnyArray
    constants: AnyArray
    state: AnyArray
    dt: float


def cubic_stress(strain: AnyArray, p: AnyArray) -> AnyArray:
    """C : strain, all in crystal axes."""
    stress: AnyArray = 2 * p[P_C44] * strain
    diagonal = np.diag(strain)
    np.fill_diagonal(stress, (p[P_C11] - p[P_C12]) * diagonal + p[P_C12] * diagonal.sum())
    return stress


def elastic_response(step: Step, slip: AnyArray) -> tuple[AnyArray, AnyArray, AnyArray]:
    """First Piola–Kirchhoff stress (3, 3), resolved shear stresses (24,), kinematic state (9,)."""
    gradient = np.einsum("s,sij->ij", slip, SCHMID)
    if step.strain_measure == "small":
        strain = step.R.T @ (step.H + step.H.T) @ step.R / 2
        plastic = np.einsum("k,kij->ij", step.state[:5], STRAIN_MODES[:5])
        plastic = plastic + (gradient + gradient.T) / 2
        stress = cubic_stress(strain - plastic, step.constants)
        modes = np.einsum("kij,ij->k", STRAIN_MODES[:5], plastic)
        tau = np.einsum("sij,ij->s", SCHMID, stress)
        return step.R @ stress @ step.R.T, tau, np.concatenate([modes, np.zeros(4)])
    trial = (np.eye(3) + step.H) @ step.R @ step.state[:9].reshape(3, 3)
    kept = np.eye(3) - gradient
    elastic = trial @ kept
    stress = cubic_stress((elastic.T @ elastic - np.eye(3)) / 2, step.constants)
    tau = np.einsum("sij,ij->s", SCHMID, trial.T @ elastic @ stress)
    inverse = step.state[:9].reshape(3, 3) @ kept
    piola = elastic @ stress @ inverse.T @ step.R.T
    return piola, tau, (inverse * np.linalg.det(inverse) ** (-1 / 3)).ravel()


def hardening(step: Step, slip: AnyArray) -> tuple[AnyArray, AnyArray]:
    """Back strains and accumulated slips at the end, (24,) each."""
    size = slip * np.sign(slip.real)
    back = (step.state[S_X:S_ACC] + slip) / (1 + step.constants[P_D] * size)
    return back, step.state[S_ACC:] + size


def residuals(step: Step, slip: AnyArray) -> AnyArray:
    """S τ − c S x − r − K (Δp/Δt)^(1/n) of each system that slips, in MPa; 0 of one at rest."""
    p, sign = step.constants, np.sign(slip.real)
    _, tau, _ = elastic_response(step, slip)
    back, total = hardening(step, slip)
    resistance = np.repeat([p[P_TAU110], p[P_TAU112]], 12) + p[P_Q] * (1 - np.exp(-p[P_B] * total))
    active = sign != 0
    rate = np.where(active, slip * sign, 1.0) / step.dt
    return np.where(
        active, sign * (tau - p[P_C] * back) - resistance - p[P_K] * rate ** (1 / p[P_N]), 0.0
    )


def overstress_at_rest(step: Step, slip: AnyArray) -> AnyArray:
    """|τ − c x| − r of each system at rest (must not be positive), −inf of one that slips."""
    p = step.constants
    _, tau, _ = elastic_response(step, slip)
    back, total = hardening(step, slip)
    resistance = np.repeat([p[P_TAU110], p[P_TAU112]], 12) + p[P_Q] * (1 - np.exp(-p[P_B] * total))
    return np.where(slip == 0, abs(tau - p[P_C] * back) - resistance, -np.inf)


def jacobian(step: Step, slip: AnyArray) -> AnyArray:
    """∂residual/∂slip of the systems that slip, by the complex step."""
    active = np.flatnonzero(slip.real)
    columns = []
    for s in active:
        bumped = slip.astype(complex)
        bumped[s] += 1j * COMPLEX_STEP
        columns.append(residuals(step, bumped).imag[active] / COMPLEX_STEP)
    return np.stack(columns, axis=1) if columns else np.zeros((0, 0))


def corrected(step: Step, slip: AnyArray) -> AnyArray:
    """Slips after one Newton step, with the Jacobian at `slip`."""
    active = np.flatnonzero(slip.real)
    change = np.linalg.solve(jacobian(step, slip), residuals(step, slip)[active])
    better = slip.copy()
    better[active] -= change
    return better


def response(step: Step, slip: AnyArray) -> tuple[AnyArray, AnyArray]:
    """First Piola–Kirchhoff stress times R (9,) and the state at the end (57,)."""
    piola, _, kinematic = elastic_response(step, slip)
    return (piola @ step.R).ravel(), np.concatenate([kinematic, *hardening(step, slip)])


def derivative(
    step: Step, slip: AnyArray, matrix: AnyArray, **tangents: AnyArray
) -> tuple[AnyArray, AnyArray]:
    """Derivative of `response` along tangents of the fields of the step.

    The slips follow by the implicit function theorem, with their Jacobian `matrix`.
    """
    moved = {
        name: getattr(step, name) + 1j * COMPLEX_STEP * value for name, value in tangents.items()
    }
    turned = replace(step, **moved)
    active = np.flatnonzero(slip)
    following = slip.astype(complex)
    following[active] -= 1j * np.linalg.solve(matrix, residuals(turned, slip).imag[active])
    stress, state = response(turned, following)
    return stress.imag / COMPLEX_STEP, state.imag / COMPLEX_STEP
