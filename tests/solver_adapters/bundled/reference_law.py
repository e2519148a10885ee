"""One time step of the general crystal law in plain NumPy, written from its equations.

It shares nothing with the kernels but the layout of parameters and state. Every function takes
complex numbers: the imaginary part carries a derivative without cancellation (complex step).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solver_adapters.bundled.law.law import (
    P_A1,
    P_ASYMMETRY,
    P_B,
    P_C,
    P_C2,
    P_C11,
    P_C12,
    P_C44,
    P_D,
    P_D2,
    P_K,
    P_LATENT,
    P_N,
    P_Q,
    P_TAU110,
    P_TAU112,
    P_TAU123,
    STRAIN_MODES,
    StateLayout,
)
from solver_adapters.crystal import BCC, BCC48, SystemTable, schmid_tensors, slip_systems

AnyArray = NDArray[Any]
COMPLEX_STEP = 1e-30


@dataclass(frozen=True, eq=False)
class Step:
    """A step of one point: displacement gradient H (3, 3), crystal rotation R (3, 3), constants
    (17,), state at the start (105,), length dt [s], factor on τ0, interaction matrix (24, 24),
    slip systems (of more than 24, state and matrix are larger); whatever is complex is
    differentiated.
    """

    strain_measure: str
    H: AnyArray
    R: AnyArray
    constants: AnyArray
    state: AnyArray
    dt: float
    exponential: bool = False
    skin: Any = 1.0
    interaction: AnyArray = field(default_factory=lambda: np.eye(24))
    systems: SystemTable = BCC

    @property
    def n(self) -> int:
        """Number of slip systems."""
        return len(self.interaction)

    def of_state(self, part: str) -> AnyArray:
        """Numbers of each system in the state: x, over, accumulated or x2."""
        start = getattr(StateLayout(self.n), part)
        return self.state[start : start + self.n]


def cubic_stress(strain: AnyArray, p: AnyArray) -> AnyArray:
    """C : strain, all in crystal axes."""
    stress: AnyArray = 2 * p[P_C44] * strain
    diagonal = np.diag(strain)
    np.fill_diagonal(stress, (p[P_C11] - p[P_C12]) * diagonal + p[P_C12] * diagonal.sum())
    return stress


def elastic_response(step: Step, slip: AnyArray) -> tuple[AnyArray, AnyArray, AnyArray]:
    """First Piola–Kirchhoff stress (3, 3), stress that drives slip (3, 3), kinematic state (9,)."""
    gradient = np.einsum("s,sij->ij", slip, schmid_tensors(step.systems))
    if step.strain_measure == "small":
        strain = step.R.T @ (step.H + step.H.T) @ step.R / 2
        plastic = np.einsum("k,kij->ij", step.state[:5], STRAIN_MODES[:5])
        plastic = plastic + (gradient + gradient.T) / 2
        stress = cubic_stress(strain - plastic, step.constants)
        modes = np.einsum("kij,ij->k", STRAIN_MODES[:5], plastic)
        return step.R @ stress @ step.R.T, stress, np.concatenate([modes, np.zeros(4)])
    trial = (np.eye(3) + step.H) @ step.R @ step.state[:9].reshape(3, 3)
    kept = np.eye(3) - gradient
    elastic = trial @ kept
    stress = cubic_stress((elastic.T @ elastic - np.eye(3)) / 2, step.constants)
    conjugate = trial.T @ elastic @ stress
    inverse = step.state[:9].reshape(3, 3) @ kept
    piola = elastic @ stress @ inverse.T @ step.R.T
    return piola, conjugate, (inverse * np.linalg.det(inverse) ** (-1 / 3)).ravel()


def driving_stress(step: Step, slip: AnyArray, sign: AnyArray) -> AnyArray:
    """Resolved shear stress along the sense of slip, with the non-Schmid part, (n,)."""
    _, stress, _ = elastic_response(step, slip)
    tau = np.einsum("sij,ij->s", schmid_tensors(step.systems), stress)
    driving = (sign * tau).astype(np.result_type(tau, step.constants))
    directions, normals = slip_systems(step.systems)
    for s in range(12 if step.systems in (BCC, BCC48) else 0):
        direction = sign[s] * directions[s]
        # The {110} plane of the zone of the slip direction at +60° from the slip plane.
        plane = rotate(normals[s], direction, np.pi / 3)
        driving[s] += step.constants[P_A1] * (direction @ stress @ plane)
    return np.asarray(driving)


def rotate(vector: AnyArray, axis: AnyArray, angle: float) -> AnyArray:
    """Turn a vector about a unit axis."""
    across = np.cross(axis, vector)
    along = axis * (axis @ vector)
    return np.asarray(along + np.cos(angle) * (vector - along) + np.sin(angle) * across)


def threshold(step: Step, sign: AnyArray, total: AnyArray) -> AnyArray:
    """Critical resolved shear stress of each system for a sense of slip, (n,)."""
    p = step.constants
    order = np.arange(step.n)
    tau0 = np.select([order < 12, order < 24], [p[P_TAU110], p[P_TAU112]], p[P_TAU123])
    if step.systems in (BCC, BCC48):
        # In the frame where m is along [111], the twinning sense has n along [-1 -1 2].
        twinning = np.sign(np.prod(slip_systems(step.systems), axis=(0, 2))) * sign
        tau0 = tau0 - np.where((order >= 12) & (order < 24), twinning, 0.0) * p[P_ASYMMETRY]
    modulus = p[P_Q] * step.interaction + p[P_LATENT] * (1 - np.eye(step.n))
    return np.asarray(step.skin * tau0 + modulus @ (1 - np.exp(-p[P_B] * total)))


def recalled(step: Step, start: AnyArray, slip: AnyArray, d: Any) -> AnyArray:
    """Back strain at the end of the step, (n,)."""
    size = slip * np.sign(slip.real)
    if step.exponential:
        sense = np.sign(slip.real)
        return np.asarray(sense / d + (start - sense / d) * np.exp(-d * size))
    return np.asarray((start + slip) / (1 + d * size))


def overstress(step: Step, slip: AnyArray) -> AnyArray:
    """Viscous stress at the end of the step of the systems that slip, (n,)."""
    p, sign = step.constants, np.sign(slip.real)
    rate = np.where(sign != 0, slip * sign, 1.0) / step.dt
    mean = p[P_K] * rate ** (1 / p[P_N])
    if not step.exponential:
        return np.asarray(mean)
    start = sign * step.of_state("over")
    falls = (sign != 0) & (mean.real < start.real)
    return np.array(
        [relaxed(mean[s], start[s], p[P_N]) if falls[s] else mean[s] for s in range(step.n)]
    )


def relaxed(mean: Any, start: Any, n: Any) -> Any:
    """End of a relaxation from `start` whose mean rate has the viscous stress `mean`.

    Newton's method on (v0 − v)/∫(K/y)ⁿ dy = mean rate, in y = v/v0.
    """
    target, y = (mean / start) ** n, 0.5 + 0j
    for _ in range(40):
        integral = (y ** (1 - n) - 1) / (n - 1)
        value = (1 - y) / integral
        slope = (-1 + value * y ** (-n)) / integral
        change = (target - value) / slope
        y = y + change if 0 < (y + change).real < 1 else (y / 2 if change.real < 0 else (1 + y) / 2)
    return start * (y if np.iscomplexobj(np.array([mean, start, n])) else y.real)


def hardening(step: Step, slip: AnyArray) -> tuple[AnyArray, ...]:
    """Back strains, overstresses, accumulated slips, second back strains at the end, (n,) each."""
    p, sign = step.constants, np.sign(slip.real)
    back = recalled(step, step.of_state("x"), slip, p[P_D])
    second = recalled(step, step.of_state("x2"), slip, p[P_D2])
    over = np.where(sign != 0, sign * overstress(step, slip), 0.0)
    total = step.of_state("accumulated") + slip * sign
    return back, over, total, second


def residuals(step: Step, slip: AnyArray) -> AnyArray:
    """S τ − c S x − c2 S x2 − r − v of each system that slips, in MPa; 0 of one at rest."""
    p, sign = step.constants, np.sign(slip.real)
    back = recalled(step, step.of_state("x"), slip, p[P_D])
    second = recalled(step, step.of_state("x2"), slip, p[P_D2])
    total = step.of_state("accumulated") + slip * sign
    driving = driving_stress(step, slip, sign) - sign * (p[P_C] * back + p[P_C2] * second)
    residual = driving - threshold(step, sign, total) - overstress(step, slip)
    return np.where(sign != 0, residual, 0.0)


def overstress_at_rest(step: Step, slip: AnyArray) -> AnyArray:
    """How far each system at rest is above its threshold in either sense; −inf of a moving one."""
    p = step.constants
    back = p[P_C] * step.of_state("x") + p[P_C2] * step.of_state("x2")
    total = step.of_state("accumulated") + abs(slip)
    both = [
        driving_stress(step, slip, sign) - sign * back - threshold(step, sign, total)
        for sign in (np.ones(step.n), -np.ones(step.n))
    ]
    return np.where(slip == 0, np.maximum(*both), -np.inf)


def jacobian(step: Step, slip: AnyArray) -> AnyArray:
    """∂residual/∂slip of the systems that slip, by the complex step."""
    active = np.flatnonzero(slip.real)
    columns = []
    for s in active:
        bumped = slip.astype(complex)
        bumped[s] += 1j * COMPLEX_STEP
        columns.append(residuals(step, bumped).imag[active] / COMPLEX_STEP)
    return np.stack(columns, axis=1) if columns else np.zeros((0, 0))


def solve(matrix: AnyArray, right: AnyArray) -> AnyArray:
    """Solution of a Jacobian's system; slips differ by ten orders of magnitude, hence scaled."""
    scale = np.diag(matrix)
    scaled = matrix / scale
    found = np.zeros(len(right), dtype=np.longdouble)
    for _ in range(3):
        rest = right - scaled.astype(np.longdouble) @ found
        found = found + np.linalg.solve(scaled, rest.astype(np.float64))
    return np.asarray((found / scale).astype(np.float64))


def corrected(step: Step, slip: AnyArray) -> AnyArray:
    """Slips after one Newton step, with the Jacobian at `slip`."""
    active = np.flatnonzero(slip.real)
    change = solve(jacobian(step, slip), residuals(step, slip)[active])
    better = slip.copy()
    better[active] -= change
    return better


def response(step: Step, slip: AnyArray) -> tuple[AnyArray, AnyArray]:
    """First Piola–Kirchhoff stress times R (9,) and the state at the end (105,)."""
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
    following[active] -= 1j * solve(matrix, residuals(turned, slip).imag[active])
    stress, state = response(turned, following)
    return stress.imag / COMPLEX_STEP, state.imag / COMPLEX_STEP
