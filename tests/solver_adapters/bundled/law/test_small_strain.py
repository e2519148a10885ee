"""The law at a point in small strain: what must hold whatever the history."""

from __future__ import annotations

import numpy as np

from meshes.arrays import FloatArray
from solver_adapters.bundled.law import NS
from solver_adapters.bundled.law.gauss_points import Points, points_of_grains
from solver_adapters.bundled.law.state_layout import S_OVER, S_X
from solver_adapters.crystal import BCC, bunge_matrix, schmid_tensors
from solver_adapters.material import Material
from tests.solver_adapters.bundled.elasticity import stiffness
from tests.solver_adapters.bundled.rest import state_at_rest

MATERIAL = Material(strain_measure="small")
R = bunge_matrix(211, 45, 150)
PULL = np.array([[-0.4, 0.1, 0.0], [0.2, 1.0, 0.1], [0.0, -0.1, -0.3]])
PATH = (0.001, 0.003, 0.006, 0.005, 0.002, 0.004)


def _points(material: Material = MATERIAL) -> Points:
    return points_of_grains(material, "exponential", np.zeros(1, dtype=np.int64), R[None])


def _history(
    points: Points, gradients: FloatArray, dt: float = 1.0
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Stresses (n, 3, 3), signed slips (n, 24) and states of steps with these gradients."""
    state, slips = state_at_rest(points), np.zeros((1, NS))
    stresses, all_slips, states = [], [], []
    for gradient in gradients:
        H = (gradient @ R).reshape(1, 9)
        found = points.update(H, state, slips, dt)
        assert found.iterations[0] >= 0
        state, slips = found.state, found.slips
        stresses.append(found.P.reshape(3, 3) @ R.T)
        all_slips.append(slips[0])
        states.append(state[0])
    return np.array(stresses), np.array(all_slips), np.array(states)


def test_stress_is_the_stiffness_times_the_strain_less_that_of_all_slips() -> None:
    """σ = C : (ε − Σ γ sym(m ⊗ n)), with the slips of every step summed."""
    gradients = np.multiply.outer(np.array(PATH), PULL)
    stresses, slips, _ = _history(_points(), gradients)
    assert np.count_nonzero(slips[2]) >= 5
    systems = R @ schmid_tensors(BCC) @ R.T
    plastic = np.einsum("ts,sij->tij", np.cumsum(slips, axis=0), systems)
    elastic = gradients - plastic
    elastic = (elastic + elastic.transpose(0, 2, 1)) / 2
    expected = np.einsum("ijkl,tkl->tij", stiffness(MATERIAL, R), elastic)
    np.testing.assert_allclose(stresses, expected, atol=1e-8)
    np.testing.assert_allclose(stresses, stresses.transpose(0, 2, 1), atol=1e-10)


def test_pressure_moves_no_system_and_acts_through_the_bulk_modulus_alone() -> None:
    gradients = np.multiply.outer(np.array(PATH), PULL)
    volume = np.array([0.0, 2e-3, -3e-3, 1e-2, 0.0, -5e-3])
    plain, slips, _ = _history(_points(), gradients)
    pressed, same, _ = _history(_points(), gradients + volume[:, None, None] * np.eye(3))
    np.testing.assert_allclose(same, slips, atol=1e-12)
    bulk = MATERIAL.C11 + 2 * MATERIAL.C12
    np.testing.assert_allclose(pressed - plain, bulk * volume[:, None, None] * np.eye(3), atol=1e-6)


def test_a_spin_of_the_specimen_leaves_a_point_without_stress() -> None:
    spin = 0.05 * np.array([[0.0, 1.0, -2.0], [-1.0, 0.0, 0.5], [2.0, -0.5, 0.0]])
    stresses, slips, _ = _history(_points(), spin[None])
    assert abs(stresses).max() < 1e-9
    assert not slips.any()


def test_long_flow_saturates_at_tau0_plus_c_over_d_plus_the_overstress_of_its_rate() -> None:
    """|τ| = τ0 + c/d + K γ̇^(1/n) on every system that has slipped by much more than 1/d."""
    dt = 2.0
    strains = np.linspace(0.0, 0.2, 81)[1:]
    stresses, slips, states = _history(_points(), np.multiply.outer(strains, PULL), dt)
    forward = (np.sign(slips[-40:]) == np.sign(slips[-1])).all(axis=0)
    steady = forward & (abs(slips[-40:].sum(axis=0)) > 20 / MATERIAL.d)
    assert np.count_nonzero(steady) >= 4
    tau = np.einsum("sij,ij->s", schmid_tensors(BCC), R.T @ stresses[-1] @ R)
    over = MATERIAL.K * (abs(slips[-1]) / dt) ** (1 / MATERIAL.n)
    expected = MATERIAL.tau0 + MATERIAL.c / MATERIAL.d + over
    np.testing.assert_allclose(abs(tau)[steady], expected[steady], rtol=1e-6)
    np.testing.assert_array_equal(np.sign(tau)[steady], np.sign(slips[-1])[steady])
    back = abs(states[-1, S_X:S_OVER])[steady]
    np.testing.assert_allclose(back, 1 / MATERIAL.d, rtol=1e-6)
