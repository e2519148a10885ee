"""The law at a point in finite strain: what must hold whatever the history."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from meshes.arrays import FloatArray
from solver_adapters.bundled.law import NS
from solver_adapters.bundled.law.gauss_points import Points, points_of_grains
from solver_adapters.crystal import bunge_matrix, rotation_vector_matrix
from solver_adapters.material import Material, StrainMeasure
from tests.solver_adapters.bundled.elasticity import stiffness
from tests.solver_adapters.bundled.rest import state_at_rest

MATERIAL = Material(strain_measure="finite")
R = bunge_matrix(211, 45, 150)
PULL = np.array([[-0.4, 0.1, 0.0], [0.2, 1.0, 0.1], [0.0, -0.1, -0.3]])
PATH = (0.001, 0.003, 0.01, 0.03, 0.028, 0.02, 0.04)


def _points(measure: StrainMeasure = "finite", **constants: Any) -> Points:
    material = replace(MATERIAL, strain_measure=measure, **constants)
    return points_of_grains(material, "exponential", np.zeros(1, dtype=np.int64), R[None])


def _history(points: Points, gradients: FloatArray) -> tuple[FloatArray, FloatArray]:
    """First Piola–Kirchhoff stresses (n, 3, 3) and states of steps of 1 s."""
    state, slips = state_at_rest(points), np.zeros((1, NS))
    H0 = np.zeros((1, 9))
    stresses, states = [], []
    for gradient in gradients:
        H = (gradient @ R).reshape(1, 9)
        found = points.update(H, state, slips, 1.0, H0)
        assert found.iterations[0] >= 0
        state, slips, H0 = found.state, found.slips, H
        stresses.append(found.P.reshape(3, 3) @ R.T)
        states.append(state[0])
    return np.array(stresses), np.array(states)


def test_elastic_stress_is_the_gradient_of_the_energy() -> None:
    """P = ∂W/∂F of W = ½ E : C : E, E Green's strain, at strains of several percent."""
    C = stiffness(MATERIAL, R)

    def energy(F: FloatArray) -> float:
        E = (F.T @ F - np.eye(3)) / 2
        return 0.5 * float(np.einsum("ij,ijkl,kl->", E, C, E))

    gradient = rotation_vector_matrix(np.array([0.3, -0.5, 0.2])) @ (np.eye(3) + 0.05 * PULL)
    gradient -= np.eye(3)
    (P,), _ = _history(_points(tau0=1e6), gradient[None])
    step = 1e-4
    for i, j in np.ndindex(3, 3):
        unit = np.zeros((3, 3))
        unit[i, j] = step
        F = np.eye(3) + gradient
        # The energy is of fourth order in F: five points are exact but for rounding.
        slope = (
            8 * (energy(F + unit) - energy(F - unit)) - energy(F + 2 * unit) + energy(F - 2 * unit)
        ) / (12 * step)
        assert P[i, j] == pytest.approx(slope, abs=1e-8 * abs(P).max())


def test_plastic_flow_keeps_the_volume_and_the_balance_of_angular_momentum() -> None:
    """det Fp = 1 and P·Fᵀ symmetric in every step of a cycle."""
    gradients = np.multiply.outer(np.array(PATH), PULL)
    P, states = _history(_points(), gradients)
    inverse = states[:, :9].reshape(-1, 3, 3)
    assert abs(inverse[-1] - np.eye(3)).max() > 0.01
    np.testing.assert_allclose(np.linalg.det(inverse), 1.0, rtol=1e-13)
    kirchhoff = P @ (np.eye(3) + gradients).transpose(0, 2, 1)
    np.testing.assert_allclose(
        kirchhoff, kirchhoff.transpose(0, 2, 1), atol=1e-12 * abs(kirchhoff).max()
    )


def test_a_closed_cycle_of_strain_dissipates() -> None:
    """∮ P : dF > 0 by the trapezoidal rule, and nothing where no system slips."""
    path = np.concatenate([np.linspace(0, 0.01, 21), np.linspace(0.01, 0, 21)[1:]])
    gradients = np.multiply.outer(path, PULL)
    works = []
    for tau0 in (40.0, 1e6):
        P, _ = _history(_points(tau0=tau0), gradients[1:])
        P = np.concatenate([np.zeros((1, 3, 3)), P])
        works.append(float(np.sum((P[1:] + P[:-1]) / 2 * np.diff(gradients, axis=0))))
    assert works[0] > 0.5  # MPa
    assert abs(works[1]) < 1e-9


def test_small_strains_have_the_stresses_of_small_strain() -> None:
    """The relative difference is of the size of the strain, elastic or plastic."""
    for size in (0.01, 0.001, 0.0001):
        gradients = size * np.multiply.outer(np.array([0.3, 0.7, 1.0, 0.9]), PULL)
        (finite, _), (small, _) = (
            _history(_points(measure), gradients) for measure in ("finite", "small")
        )
        assert 0.1 * size < abs(finite - small).max() / abs(small).max() < 3.0 * size


def test_an_element_turned_inside_out_is_no_solution() -> None:
    """A mirror leaves Green's strain, and so the stress, as it is: the determinant tells."""
    mirror = np.diag([1.0, 1.0, -1.0])
    points, rest = _points(), np.zeros((1, NS))
    for F, solvable in ((np.eye(3), True), (mirror, False)):
        H = ((F - np.eye(3)) @ R).reshape(1, 9)
        found = points.update(H, state_at_rest(points), rest, 1.0)
        assert (found.iterations[0] >= 0) == solvable
