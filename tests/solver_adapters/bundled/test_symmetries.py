"""What must not change the answer: names of grains, the cube group, the frame of the observer."""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations, product

import numpy as np

from meshes.arrays import FloatArray, IntArray
from solver_adapters.bundled.adapter import BundledAdapter
from solver_adapters.bundled.fem.problem import build_problem
from solver_adapters.crystal import rotation_vector_matrix
from solver_adapters.interface import Response, Simulation
from solver_adapters.material import Material, StrainMeasure
from tools.boxes import BOXES, ORIENTATIONS, pulled

R = ORIENTATIONS[1]
HISTORY = (0.002, 0.006)
CUBE_TURNS = np.array(
    [
        turn
        for order in permutations(range(3))
        for signs in product((-1.0, 1.0), repeat=3)
        if np.linalg.det(turn := np.diag(signs)[:, order]) > 0
    ]
)


def solve(simulation: Simulation) -> Response:
    return BundledAdapter().solve(simulation)


def test_grains_of_one_orientation_are_one_grain(kind: str, measure: StrainMeasure) -> None:
    """Two and three grains by group; and the names of grains do not matter."""
    simulation = pulled(BOXES[kind]((2, 3, 1)), Material(strain_measure=measure), HISTORY)
    layer = simulation.mesh.points[simulation.mesh.cells].mean(axis=1)[:, 1] // (4 / 3)
    three = replace(simulation.mesh, grain=layer.astype(np.int64))
    assert three.n_grains == 3
    a, b = ORIENTATIONS

    def force(grain: IntArray, orientations: list[FloatArray]) -> FloatArray:
        mesh = replace(three, grain=grain)
        return solve(replace(simulation, mesh=mesh, orientations=np.array(orientations))).force

    alone = force(np.zeros_like(three.grain), [b])
    np.testing.assert_allclose(force(np.minimum(three.grain, 1), [b, b]), alone, rtol=1e-11)
    np.testing.assert_allclose(force(three.grain, [b, b, b]), alone, rtol=1e-11)
    mixed = force(three.grain, [b, a, b])
    assert abs(mixed - alone).max() > 5
    np.testing.assert_allclose(force((three.grain == 1).astype(int), [b, a]), mixed, rtol=1e-11)
    renamed = np.array([2, 0, 1])[three.grain]
    np.testing.assert_allclose(force(renamed, [a, b, b]), mixed, rtol=1e-11)


def test_none_of_the_24_cube_rotations_changes_the_answer_of_a_crystal(
    measure: StrainMeasure,
) -> None:
    """All points strained alike in the specimen, their crystals turned by the cube group."""
    assert len(CUBE_TURNS) == 24
    mesh = BOXES["tet10"]((1, 4, 1))
    mesh = replace(mesh, grain=np.arange(24))
    simulation = pulled(mesh, Material(strain_measure=measure), HISTORY)
    problem = build_problem(replace(simulation, orientations=R @ CUBE_TURNS))
    turns = (R @ CUBE_TURNS)[problem.points.grain]
    pull = np.array([[-0.4, 0.1, 0.0], [0.2, 1.0, 0.1], [0.0, -0.1, -0.3]])
    state, slips = problem.state, np.zeros((len(turns), 24))
    for strain in HISTORY:
        H = (strain * pull @ turns).reshape(-1, 9)
        found = problem.points.update(H, state, slips, 1.0)
        assert found.iterations.min() >= 0
        state, slips = found.state, found.slips
    assert (np.count_nonzero(slips, axis=1) >= 5).all()
    stress = found.P.reshape(-1, 3, 3) @ turns.transpose(0, 2, 1)
    np.testing.assert_allclose(stress, np.broadcast_to(stress[0], stress.shape), atol=1e-8)


def test_specimen_and_crystal_turned_together_turn_the_answer(
    kind: str, measure: StrainMeasure
) -> None:
    simulation = pulled(BOXES[kind](), Material(strain_measure=measure), HISTORY, tolerance=1e-11)
    turn = rotation_vector_matrix(np.array([0.5, -1.1, 0.8]))
    mesh = replace(simulation.mesh, points=simulation.mesh.points @ turn.T)
    turned = replace(
        simulation,
        mesh=mesh,
        motion=simulation.motion @ turn.T,
        orientations=turn @ simulation.orientations,
    )
    found, expected = solve(turned).displacement, solve(simulation).displacement @ turn.T
    np.testing.assert_allclose(found, expected, atol=1e-9 * abs(expected).max())


def test_a_large_rigid_turn_on_top_of_a_plastic_strain_turns_the_stress_along() -> None:
    """Objectivity of one step at finite strain: P(QF) = Q P(F), the same slips and states."""
    simulation = pulled(BOXES["tet10"](), Material(strain_measure="finite"), HISTORY)
    problem = build_problem(simulation)
    turns = simulation.orientations[problem.points.grain]
    noise = np.random.default_rng(2).normal(size=(len(turns), 3, 3))
    F = np.eye(3) + 0.006 * (np.diag([-0.4, 1.0, -0.4]) + 0.2 * noise)
    Q = rotation_vector_matrix(np.array([1.2, -0.4, 0.9]))
    rest = np.zeros((len(turns), 24))
    answers = []
    for motion in (F, Q @ F):
        H = ((motion - np.eye(3)) @ turns).reshape(-1, 9)
        found = problem.points.update(H, problem.state, rest, 1.0)
        assert found.iterations.min() > 0
        answers.append((found.state, found.slips, found.P.reshape(-1, 3, 3)))
    (state, slips, P), (state_q, slips_q, P_q) = answers
    assert (np.count_nonzero(slips, axis=1) >= 3).all()
    np.testing.assert_allclose(P_q, Q @ P, atol=1e-8 * abs(P).max())
    np.testing.assert_allclose(slips_q, slips, atol=1e-12)
    np.testing.assert_allclose(state_q, state, atol=1e-8 * abs(state).max())
