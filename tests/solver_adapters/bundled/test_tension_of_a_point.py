"""A point in free tension: where slip begins, and how the lattice turns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import polar

from meshes.arrays import FloatArray
from solver_adapters.bundled.fem.problem import build_problem
from solver_adapters.bundled.law.gauss_points import PointSolution
from solver_adapters.crystal import (
    BCC,
    FCC,
    SystemTable,
    rotation_vector_matrix,
    schmid_tensors,
    slip_systems,
)
from solver_adapters.interface import Simulation
from solver_adapters.material import Material, StrainMeasure
from tests.solver_adapters.bundled.elasticity import stiffness
from tools.boxes import BOXES, one_grain, pulled


def _uniaxial(problem_of: Simulation, stretches: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Axial stress and F of a point pulled along a material line that keeps its direction Y.

    The lateral faces are free: Newton on the rest of F with the tangent of the law, with the turn
    about Y fixed by F_xz = F_zx.
    """
    problem = build_problem(problem_of)
    crystal = problem_of.orientations[0]
    n = problem.points.grain.size
    turn = np.kron(np.eye(3), crystal)  # ∂u/∂X row by row → H = ∂u/∂X·R
    free = [0, 2, 3, 5, 6, 8]
    gauge = np.array([0.0, 1.0, 0.0, 0.0, -1.0, 0.0]) * 1e3

    def answer(F: FloatArray) -> tuple[FloatArray, PointSolution]:
        H = np.tile((F - np.eye(3)).ravel() @ turn, (n, 1))
        found = problem.points.update(H, state, slips, 1.0, strained)
        residual = np.append((turn @ found.P[0])[free], gauge @ F.ravel()[free])
        solved = found.iterations[0] >= 0 and np.isfinite(residual).all()
        return residual if solved else np.full(7, np.inf), found

    F, rate = np.eye(3), np.zeros((3, 3))
    state, slips, before = problem.state, np.zeros((n, 24)), 1.0
    strained = np.zeros((n, 9))
    stresses, gradients = [], []
    for stretch in stretches:
        last = F
        F = F + rate * (stretch - before)
        F[:, 1] = [0.0, stretch, 0.0]
        residual, end = answer(F)
        for _ in range(60):
            if abs(residual).max() < 1e-7:
                break
            matrix = np.vstack([(turn @ end.C[0] @ turn.T)[np.ix_(free, free)], gauge])
            step = np.linalg.lstsq(matrix, residual, rcond=None)[0]
            for length in 0.5 ** np.arange(12):
                trial = F.copy()
                trial.ravel()[free] -= length * step
                changed, answered = answer(trial)
                if np.linalg.norm(changed) < np.linalg.norm(residual):
                    break
            F, residual, end = trial, changed, answered
        assert abs(residual).max() < 1e-7
        rate, before = (F - last) / (stretch - before), stretch
        state, slips = end.state, end.slips
        strained = np.tile((F - np.eye(3)).ravel() @ turn, (n, 1))
        stresses.append((turn @ end.P[0])[4])
        gradients.append(F)
    return np.array(stresses), np.array(gradients)


def _pulled_point(material: Material, orientation: FloatArray) -> Simulation:
    simulation = pulled(one_grain(BOXES["tet10"]((1, 1, 1))), material, (0.0,))
    return replace(simulation, orientations=orientation[None])


@pytest.mark.parametrize("systems", [BCC, FCC], ids=["bcc", "fcc"])
def test_slip_begins_at_the_stress_of_the_largest_schmid_factor(
    systems: SystemTable, measure: StrainMeasure
) -> None:
    """Elastic at 99.7 % of τ0/μ, plastic from 101 % on, for several orientations."""
    material = Material(strain_measure=measure, slip_systems=systems, c=0.0, K=1e-2)
    for angles in ((0.3, 0.2, 0.1), (1.0, -0.5, 0.4), (-0.2, 0.9, 2.0)):
        orientation = rotation_vector_matrix(np.array(angles))
        axis = orientation.T @ [0.0, 1.0, 0.0]
        factors = abs(np.einsum("i,sij,j->s", axis, schmid_tensors(systems), axis))
        onset = material.tau0 / factors.max()
        C = stiffness(material, orientation).reshape(9, 9)
        compliance = np.linalg.pinv(C)[4, 4]
        steps = onset * compliance * np.array([0.5, 0.997, 1.01, 1.02])
        stress, _ = _uniaxial(_pulled_point(material, orientation), 1 + steps)
        # Finite strain: P, τ and S differ by the strain, 1e-3.
        rounding = 1e-8 if measure == "small" else 2e-3
        np.testing.assert_allclose(stress[0], 0.5 * onset, rtol=rounding)
        np.testing.assert_allclose(stress[1], 0.997 * onset, rtol=rounding)
        np.testing.assert_allclose(stress[3], onset, rtol=rounding + 1e-4)


@pytest.mark.parametrize(("systems", "turn"), [(BCC, 0.08), (FCC, 0.04)], ids=["bcc", "fcc"])
def test_the_lattice_of_a_crystal_in_single_slip_turns_by_the_law_of_schmid_and_boas(
    systems: SystemTable, turn: float
) -> None:
    """Tension along a material line: sin λ = sin λ0 · l0/l, λ from the axis to the slip direction.

    Schmid and Boas, Kristallplastizität (1935), for a rigid lattice: hence the tolerance, of the
    size of the elastic strain.
    """
    material = Material(strain_measure="finite", slip_systems=systems, c=0.0)
    directions, normals = slip_systems(systems)
    factors = np.einsum("si,sj->sij", directions, normals)
    best, orientation = None, np.eye(3)
    for seed in range(60):
        # The orientation with the clearest single slip.
        vector = np.random.default_rng(seed).normal(size=3)
        candidate = rotation_vector_matrix(vector)
        axis = candidate.T @ [0.0, 1.0, 0.0]
        size = np.sort(abs(np.einsum("i,sij,j->s", axis, factors, axis)))
        if best is None or size[-2] / size[-1] < best:
            best, orientation = size[-2] / size[-1], candidate
    axis = orientation.T @ [0.0, 1.0, 0.0]
    system = int(np.argmax(abs(np.einsum("i,sij,j->s", axis, factors, axis))))
    begin = 1 + np.arange(1, 10) * 1e-4
    stretches = np.append(begin, np.linspace(1.0, 1.06, 61)[1:])
    _, gradients = _uniaxial(_pulled_point(material, orientation), stretches)
    sine = np.linalg.norm(np.cross(axis, directions[system]))
    for stretch, F in zip(stretches[-21::10], gradients[-21::10], strict=True):
        m, n = directions[system], normals[system]
        expected = np.arcsin(sine / stretch)
        along = orientation.T @ F @ orientation
        slip = _slip_of(along, m, n)
        lattice, _ = polar(along @ (np.eye(3) - slip * np.outer(m, n)))
        turned = lattice.T @ axis
        found = np.arcsin(np.linalg.norm(np.cross(turned, m)))
        assert found == pytest.approx(expected, abs=3e-4)
    assert np.arcsin(sine) - expected > turn


def _slip_of(F: FloatArray, m: FloatArray, n: FloatArray) -> float:
    """Slip γ for which F (I − γ m ⊗ n) is nearest to a rotation."""
    low = float(np.einsum("i,ij,j->", m, F.T @ F, n))
    return low / float(np.einsum("i,ij,j->", m, F.T @ F, m))
