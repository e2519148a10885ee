"""What does not change while a simulation runs, against sums over the mesh."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from solver_adapters.bundled.fem.assembly import displacement_gradients, element_forces
from solver_adapters.bundled.fem.problem import Problem, build_problem, build_tangents
from solver_adapters.bundled.law.law import local_parameters, longer_step_tangent
from solver_adapters.bundled.law.state_layout import N_STATE, S_ACC
from solver_adapters.interface import Direction, Simulation
from solver_adapters.material import Material
from tools.boxes import BOXES, ORIENTATIONS, box, pulled

SIZE = (2.0, 4.0, 3.0)


@pytest.fixture
def simulation(kind: str) -> Simulation:
    return pulled(BOXES[kind]((2, 2, 2), SIZE, jitter=0.2), Material(), (0.002, 0.004))


@pytest.fixture
def problem(simulation: Simulation) -> Problem:
    return build_problem(simulation)


def test_every_degree_of_freedom_is_either_free_or_prescribed(
    simulation: Simulation, problem: Problem
) -> None:
    both = np.concatenate([problem.pattern.free, problem.prescribed])
    np.testing.assert_array_equal(np.sort(both), np.arange(3 * problem.n_nodes))
    y = simulation.mesh.points[problem.prescribed // 3, 1]
    assert set(np.unique(y)) == {0.0, SIZE[1]}


def test_the_prescribed_motion_is_that_of_the_masked_components(simulation: Simulation) -> None:
    mask = simulation.motion_mask.copy()
    mask[::2, 0] = False
    problem = build_problem(replace(simulation, motion_mask=mask))
    assert problem.prescribed.size == mask.sum()
    u = np.zeros((problem.n_nodes, 3))
    u.ravel()[problem.prescribed] = problem.motion[2]
    expected = np.where(mask, simulation.motion[2], 0.0)
    np.testing.assert_array_equal(u[simulation.motion_nodes], expected)


def test_gradients_of_a_linear_motion_are_its_gradient_in_the_axes_of_each_crystal(
    simulation: Simulation, problem: Problem
) -> None:
    gradient = np.random.default_rng(0).normal(size=(3, 3))
    H = np.empty((problem.weights.size, 9))
    u = simulation.mesh.points @ gradient.T
    displacement_gradients(u, problem.cells, problem.gradients, H)
    turned = gradient @ ORIENTATIONS[problem.points.grain]
    np.testing.assert_allclose(H.reshape(-1, 3, 3), turned, atol=1e-12)
    np.testing.assert_allclose(problem.weights.sum(), np.prod(SIZE), rtol=1e-13)
    assert problem.length == SIZE[1]


def test_the_pull_of_a_stress_is_the_force_on_the_pulled_face(problem: Problem) -> None:
    """For any stress, in equilibrium or not; null beyond the cells that touch the face."""
    P = np.random.default_rng(1).normal(size=(problem.weights.size, 9))
    forces = np.empty(problem.pattern.dofs.shape)
    element_forces(P, problem.gradients, problem.weights, forces)
    expected = problem.pattern.node_sum(forces, problem.n_nodes)[problem.pulled].sum()
    np.testing.assert_allclose((problem.pull * P).sum(), expected, rtol=1e-11)
    touched = np.isin(problem.cells, problem.pulled // 3).any(axis=1)
    near = np.repeat(touched, problem.weights.shape[1])
    assert 0 < near.sum() < near.size
    assert set(problem.near_pulled) <= set(np.flatnonzero(near))
    np.testing.assert_array_equal(problem.pull[~near], 0.0)


def test_a_uniform_stress_pulls_with_stress_times_section(problem: Problem) -> None:
    stress = np.array([[0.0, 7.0, 1.0], [7.0, 50.0, -4.0], [1.0, -4.0, 20.0]])
    P = (stress @ ORIENTATIONS[problem.points.grain]).reshape(-1, 9)
    np.testing.assert_allclose((problem.pull * P).sum(), 50.0 * SIZE[0] * SIZE[2], rtol=1e-12)


def test_an_eigenstrain_or_its_derivative_makes_the_problem_a_strained_one() -> None:
    plain = pulled(BOXES["tet10"](), Material(), (0.002,))
    asked = replace(plain, directions=(Direction("e", material={"eigenstrain": 1.0}),))
    strained = replace(plain, material=Material(eigenstrain=1e-4))
    assert [build_problem(s).strained for s in (plain, asked, strained)] == [False, True, True]


def test_tangents_are_difference_quotients_of_the_problem(simulation: Simulation) -> None:
    """Gradients, weights, constants, rotations, motion and state along one mixed direction."""
    material = Material(x0=3e-5, tau0_grain2=0.9, c2=900.0)
    rates = {"tau0": 2.0, "tau0_grain2": 0.1, "x0": 1e-4}
    rotation = np.array([[0.3, -0.2, 0.5], [-0.1, 0.4, 0.2]])
    motion = np.random.default_rng(2).normal(size=simulation.motion.shape)
    velocity = np.sin(simulation.mesh.points[:, [1, 2, 0]] + 0.4)
    direction = Direction(
        "mixed", material=rates, rotation=rotation, motion=motion, points=velocity
    )
    other = Direction("K", material={"K": 1.0})
    middle = replace(simulation, material=material, directions=(other, direction))

    def along(step: float) -> Problem:
        turns = Rotation.from_rotvec(step * rotation).as_matrix()
        changes = {n: getattr(material, n) + step * v for n, v in rates.items()}
        points = simulation.mesh.points + step * velocity
        return build_problem(
            replace(
                middle,
                material=replace(material, **changes),
                orientations=turns @ simulation.orientations,
                motion=simulation.motion + step * motion,
                mesh=replace(simulation.mesh, points=points),
            )
        )

    tangents = build_tangents(middle, build_problem(middle))
    step = 1e-5
    high, low = along(step), along(-step)
    assert tangents.count == 2
    np.testing.assert_array_equal(tangents.geometric, [1])
    turn = tangents.law.turn[0, 1]
    for found, above, below in (
        (tangents.gradients[0], high.gradients, low.gradients),
        (
            tangents.weighted[0],
            high.weights[..., None, None] * high.gradients,
            low.weights[..., None, None] * low.gradients,
        ),
        (tangents.law.local[:, 1], high.points.local, low.points.local),
        (
            tangents.law.frame[turn],
            high.points.frame(high.points.rotation),
            low.points.frame(low.points.rotation),
        ),
        (tangents.motion[:, :, 1], high.motion, low.motion),
        (tangents.state[:, :, 1], high.state, low.state),
    ):
        expected = (above - below) / (2 * step)
        assert abs(expected).max() > 0
        np.testing.assert_allclose(found, expected, atol=1e-8 * abs(expected).max())
    assert (tangents.law.turn == [[0, 1], [0, 1]]).all() and not tangents.motion[:, :, 0].any()
    stiffer = local_parameters(replace(material, K=material.K + 1.0), 2)
    np.testing.assert_allclose(
        tangents.law.local[:, 0], stiffer - local_parameters(material, 2), atol=1e-10
    )


@pytest.mark.parametrize("bent", [False, True])
def test_a_turn_of_one_grain_leaves_the_points_of_the_other_alone(bent: bool) -> None:
    simulation = pulled(box(), Material(), (0.002,))
    gradient = np.array([[0.0, 1e-3, 0.0], [0.0, 0.0, 1e-3]]) if bent else None
    directions = tuple(
        Direction(f"turn {grain}", rotation=np.eye(2)[grain][:, None] * np.ones(3))
        for grain in (0, 1)
    )
    simulation = replace(simulation, lattice_gradient=gradient, directions=directions)
    problem = build_problem(simulation)
    law = build_tangents(simulation, problem).law
    np.testing.assert_array_equal(law.turn, [[1, 0], [0, 2]])
    for grain in (0, 1):
        turned = law.frame[1 + grain].reshape(len(problem.points.rotation), -1).any(axis=1)
        of_point = turned[problem.points.frame_of]
        np.testing.assert_array_equal(of_point, problem.points.grain == grain)


def test_the_law_follows_times_over_the_intervals_that_change_their_length() -> None:
    """The second of three intervals grows by a tenth for each unit; the first only shifts."""
    simulation = pulled(BOXES["tet10"](), Material(), (0.001, 0.002, 0.003), interval=5.0)
    shifted = Direction("shifted", times=np.array([2.0, 2.0, 2.5, 2.5]))
    simulation = replace(simulation, directions=(Direction("K", material={"K": 1.0}), shifted))
    problem = build_problem(simulation)
    tangents = build_tangents(simulation, problem)
    np.testing.assert_allclose(
        tangents.lengthening, [[0.0, 0.0], [0.0, 0.1], [0.0, 0.0]], atol=1e-15
    )
    for interval in (0, 2):
        assert tangents.law_over(interval) is tangents.law
    n_grains = len(tangents.law.local)
    assert tangents.law.changes.tolist() == n_grains * [[True, False]]
    longer = tangents.law_over(1)
    assert longer.changes.all()
    np.testing.assert_array_equal(longer.local[:, 0], tangents.law.local[:, 0])
    np.testing.assert_allclose(
        longer.local[:, 1], 0.1 * longer_step_tangent(problem.points.local), rtol=1e-14
    )


def test_derivatives_carry_of_the_state_no_more_than_has_an_effect(kind: str) -> None:
    """Accumulated slip matters with hardening alone, a second back strain where it is weighed."""
    directions = (Direction("c2", material={"c2": 1.0}),)
    laws = ((Material(), S_ACC), (Material(Q=10.0), N_STATE), (Material(c2=10.0), N_STATE))
    for material, size in laws:
        simulation = replace(pulled(BOXES[kind](), material, (0.0,)), directions=directions)
        tangents = build_tangents(simulation, build_problem(simulation))
        assert tangents.state.shape[1:] == (size, 1)
