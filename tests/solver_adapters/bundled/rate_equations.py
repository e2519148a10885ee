"""The rate equations of the law at one point, integrated by Radau as they stand in METHOD."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp

from meshes.arrays import FloatArray
from solver_adapters.crystal import SystemTable
from solver_adapters.material import Material


def cauchy_stress(
    material: Material,
    systems: SystemTable,
    rotation: FloatArray,
    gradient: Callable[[float], FloatArray],
    instants: FloatArray,
) -> FloatArray:
    """Return the stress of a point in finite strain, without isotropic hardening.

    Mandel's stress drives slip, Ḟp⁻¹ = −Fp⁻¹ Σ γ̇ m⊗n, ẋ = γ̇ − d x |γ̇|.

    Args:
        material: constants.
        systems: plane normals and slip directions.
        rotation: crystal → specimen, shape (3, 3).
        gradient: displacement gradient ∂u/∂X at an instant.
        instants: where the stress is wanted [s], shape (T,), from the rest on.

    Returns:
        Cauchy stress in the specimen frame [MPa], shape (T, 3, 3).
    """
    normals, directions = (np.array(part, dtype=float) for part in zip(*systems, strict=True))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    n = len(normals)
    # The family of a system by the length of its plane normal, and not by its place in the table.
    ratios = {1 + 1 + 4: material.tau0_112, 1 + 4 + 9: material.tau0_123}
    families = [round(sum(index**2 for index in plane)) for plane, _ in systems]
    critical = material.tau0 * np.array([ratios.get(family, 1.0) for family in families])

    def elastic(t: float, inverse: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Fe from the crystal at rest, and the second Piola–Kirchhoff stress in its axes."""
        Fe = (np.eye(3) + gradient(t)) @ rotation @ inverse
        strain = 0.5 * (Fe.T @ Fe - np.eye(3))
        stress = 2 * material.C44 * strain
        diagonal = np.diag(strain)
        np.fill_diagonal(
            stress,
            (material.C11 - material.C12) * diagonal + material.C12 * diagonal.sum(),
        )
        return Fe, stress

    def rates(t: float, y: FloatArray) -> FloatArray:
        inverse, x = y[:9].reshape(3, 3), y[9:]
        Fe, stress = elastic(t, inverse)
        mandel = Fe.T @ Fe @ stress
        tau = np.einsum("si,ij,sj->s", directions, mandel, normals) - material.c * x
        over = np.maximum(np.abs(tau) - critical, 0.0)
        # The bound is that of no solution: it keeps trial steps finite.
        slip = np.sign(tau) * np.minimum(over / material.K, 10.0) ** material.n
        velocity = np.einsum("s,si,sj->ij", slip, directions, normals)
        back = slip - material.d * x * np.abs(slip)
        return np.concatenate([(-inverse @ velocity).ravel(), back])

    start = np.concatenate([np.eye(3).ravel(), np.zeros(n)])
    y = start
    stresses = [np.zeros((3, 3))]
    # From instant to instant, so that no step passes over a turning point.
    for begin, end in zip(instants[:-1], instants[1:], strict=True):
        solved = solve_ivp(
            rates, (begin, end), y, method="Radau", rtol=1e-7, atol=1e-10, first_step=1e-3
        )
        assert solved.success
        y = solved.y[:, -1]
        Fe, stress = elastic(end, y[:9].reshape(3, 3))
        stresses.append(Fe @ stress @ Fe.T / np.linalg.det(Fe))
    return np.array(stresses)
