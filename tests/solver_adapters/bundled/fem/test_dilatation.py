"""Mean dilatation: the map and its derivative, and what it cures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from meshes.arrays import FloatArray
from solver_adapters.bundled.adapter import BundledAdapter
from solver_adapters.bundled.fem import assembly
from solver_adapters.bundled.fem.dilatation import (
    Dilatation,
    dilatation_changes,
    mean_dilatation,
    projection,
)
from solver_adapters.bundled.fem.element import element_of, shape_gradient_velocity, shape_gradients
from solver_adapters.bundled.fem.problem import Problem, build_problem
from solver_adapters.crystal import rotation_vector_matrix
from solver_adapters.interface import Simulation
from solver_adapters.material import Material
from tools.boxes import BOXES, one_grain, pulled

RNG = np.random.default_rng(8)


@pytest.fixture
def simulation(kind: str) -> Simulation:
    mesh = BOXES[kind]((2, 2, 2), (2.0, 4.0, 3.0), jitter=0.2)
    return replace(pulled(mesh, Material(), (0.002,)), mean_dilatation=True)


@pytest.fixture
def problem(simulation: Simulation) -> Problem:
    return build_problem(simulation)


def mapped(dilatation: Dilatation | None, values: FloatArray) -> FloatArray:
    assert dilatation is not None
    result = values.copy()
    dilatation.project(result)
    return result


def test_a_projection_keeps_its_functions_and_is_its_own_square_and_adjoint() -> None:
    functions = np.column_stack([np.ones(8), RNG.normal(size=(8, 3))])
    weights = RNG.uniform(0.5, 2.0, (3, 8))
    P = projection(functions, weights)
    np.testing.assert_allclose(P @ functions, np.tile(functions, (3, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(P @ P, P, atol=1e-12)
    np.testing.assert_allclose(
        weights[:, :, None] * P, (weights[:, :, None] * P).transpose(0, 2, 1), atol=1e-12
    )


def test_the_dilatation_is_projected_and_nothing_else_changes(problem: Problem) -> None:
    """In the specimen frame, where H·Rᵀ is the displacement gradient."""
    H = RNG.normal(size=(problem.weights.size, 9))
    rotation = problem.points.rotation[problem.points.frame_of]
    before, after = (
        values.reshape(-1, 3, 3) @ rotation.transpose(0, 2, 1)
        for values in (H, mapped(problem.dilatation, H))
    )
    deviator = np.eye(3) / 3.0
    trace = np.trace(before, axis1=1, axis2=2).reshape(problem.weights.shape)
    P = projection(problem.element.dilatation, problem.weights)
    expected = np.einsum("eqr,er->eq", P, trace).ravel()
    np.testing.assert_allclose(np.trace(after, axis1=1, axis2=2), expected, atol=1e-12)
    np.testing.assert_allclose(
        after - deviator * np.trace(after, axis1=1, axis2=2)[:, None, None],
        before - deviator * np.trace(before, axis1=1, axis2=2)[:, None, None],
        atol=1e-12,
    )


def test_a_homogeneous_motion_is_left_alone(simulation: Simulation, problem: Problem) -> None:
    u = simulation.mesh.points @ RNG.normal(size=(3, 3)).T
    plain = build_problem(replace(simulation, mean_dilatation=False))
    np.testing.assert_allclose(problem.strain(u), plain.strain(u), atol=1e-12)


def test_mapped_stresses_do_the_work_of_stresses_on_mapped_strains(problem: Problem) -> None:
    P, H = RNG.normal(size=(2, problem.weights.size, 9))
    weights = problem.weights.ravel()
    on_strain = weights @ (P * mapped(problem.dilatation, H)).sum(axis=1)
    of_stress = weights @ (mapped(problem.dilatation, P) * H).sum(axis=1)
    np.testing.assert_allclose(of_stress, on_strain, rtol=1e-12)


def test_directions_are_mapped_as_their_columns(problem: Problem) -> None:
    values = RNG.normal(size=(problem.weights.size, 9, 3))
    assert problem.dilatation is not None
    together = values.copy()
    problem.dilatation.project_directions(together)
    for k in range(3):
        np.testing.assert_allclose(
            together[:, :, k], mapped(problem.dilatation, values[:, :, k]), atol=1e-12
        )


@pytest.mark.parametrize("part", [0, 1, -1])
def test_the_stiffness_is_that_of_the_mapped_strain(problem: Problem, part: int) -> None:
    C = RNG.normal(size=(problem.weights.size, 9, 9))
    if part == 0:
        C = C + C.transpose(0, 2, 1)
    n_cells, n = problem.pattern.dofs.shape
    low = np.array([(i, j) for j in range(n) for i in range(j, n)])
    K = np.empty((n_cells, len(low)))
    assembly.element_stiffness(C, problem.gradients, problem.weights, K, part, problem.dilatation)
    cell, n_gauss = 1, problem.weights.shape[1]
    rows = slice(n_gauss * cell, n_gauss * (cell + 1))
    columns = []
    for component in range(3):
        for node in problem.cells[cell]:
            u = np.zeros((problem.n_nodes, 3))
            u[node, component] = 1.0
            columns.append(problem.strain(u)[rows])
    B = np.array(columns)
    dense = np.einsum("q,iqm,qmn,jqn->ij", problem.weights[cell], B, C[rows], B)
    expected = {0: dense, 1: (dense + dense.T) / 2, -1: (dense - dense.T) / 2}[part]
    scale = abs(expected).max()
    np.testing.assert_allclose(K[cell], expected[low[:, 0], low[:, 1]], atol=1e-12 * scale)


@pytest.mark.parametrize(("moves", "turns"), [(1.0, 1.0), (1.0, 0.0), (0.0, 1.0)])
def test_the_derivative_of_the_map_is_its_difference_quotient(
    simulation: Simulation, moves: float, turns: float
) -> None:
    """Where nodes move, crystals turn, or both, among directions that change nothing."""
    mesh = simulation.mesh
    element = element_of(mesh.cells)
    velocity = moves * RNG.normal(size=mesh.points.shape)
    spin = turns * RNG.normal(size=(mesh.n_grains, 3))
    frame_of = np.repeat(mesh.grain, len(element.weights))
    H = RNG.normal(size=(frame_of.size, 9))

    def at(step: float) -> Dilatation:
        rotations = np.stack([rotation_vector_matrix(step * vector) for vector in spin])
        gradients, weights = shape_gradients(mesh.points + step * velocity, mesh.cells, element)
        return mean_dilatation(
            element.dilatation, gradients, weights, rotations @ simulation.orientations, frame_of
        )

    gradients, weights = shape_gradients(mesh.points, mesh.cells, element)
    _, weight_change = shape_gradient_velocity(gradients, weights, mesh.cells, velocity)
    skew = np.stack([np.cross(vector, np.eye(3)).T for vector in spin])
    turned = skew @ simulation.orientations
    still = np.zeros_like(weights), np.zeros_like(turned)
    changes = dilatation_changes(
        element.dilatation, weights, (still[0], weight_change), (still[1], turned), frame_of
    )
    step = 1e-6
    expected = (mapped(at(step), H) - mapped(at(-step), H)) / (2 * step)
    before = RNG.normal(size=(*H.shape, 4))
    directions, where = before.copy(), np.array([0, 2])
    at(0.0).add_changes(H, changes, np.ones((2, len(weights)), np.bool_), where, directions)
    added = directions - before
    np.testing.assert_allclose(added[:, :, 2], expected, atol=1e-7 * abs(expected).max())
    assert not added[:, :, [0, 1, 3]].any()
    # Where a direction changes nothing in a cell, that is left out.
    at(0.0).add_changes(H, changes, np.zeros((2, len(weights)), np.bool_), where, directions)
    np.testing.assert_array_equal(directions - before, added)


def carried(kind: str, divisions: tuple[int, int, int], mean: bool) -> float:
    """Load [µN] of a clamped bar that flows, without hardening."""
    material = Material(strain_measure="small", c=0.0, K=5.0)
    mesh = one_grain(BOXES[kind](divisions))
    simulation = pulled(mesh, material, (0.002, 0.005, 0.01, 0.015), interval=10.0, tolerance=1e-7)
    response = BundledAdapter().solve(replace(simulation, mean_dilatation=mean))
    assert response.force[4] < 1.01 * response.force[3]  # it flows
    return float(response.force[4])


def test_a_bar_that_flows_carries_less_with_the_map_and_no_less_than_its_limit(kind: str) -> None:
    """A limit load is approached from above; 6 × 12 × 6 hexahedra carry 357.2 µN."""
    for divisions in ((2, 4, 2), (3, 6, 3)):
        assert 357.0 < carried(kind, divisions, True) < carried(kind, divisions, False)


def test_few_tetrahedra_with_the_map_carry_less_than_many_without_it() -> None:
    assert carried("tet10", (2, 4, 2), True) < carried("tet10", (3, 6, 3), False)
