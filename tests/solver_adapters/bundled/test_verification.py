"""Both elements and the law against what is known exactly, or by a convergence rate.

The material is that of the paper unless a test says otherwise.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations, product

import numpy as np
import pytest
from scipy.linalg import polar

from meshes.prism_mesh import PrismMesh
from solver_adapters.bundled.adapter import BundledAdapter
from solver_adapters.bundled.assembly import (
    displacement_gradients,
    element_forces,
    element_stiffness,
)
from solver_adapters.bundled.element import tet10_shape, wedge15_shape
from solver_adapters.bundled.linear import SymmetricSolver
from solver_adapters.bundled.problem import build_problem
from solver_adapters.crystal import rotation_vector_matrix, schmid_tensors, slip_systems
from solver_adapters.interface import Direction, FloatArray, IntArray, Response, Simulation
from solver_adapters.material import Material, StrainMeasure
from tests.solver_adapters.boxes import BOXES, ORIENTATIONS, moved, pulled, skin

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


@pytest.fixture(params=["tet10", "wedge15"])
def kind(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(params=["small", "finite"])
def measure(request: pytest.FixtureRequest) -> StrainMeasure:
    name: StrainMeasure = request.param
    return name


def solve(simulation: Simulation) -> Response:
    return BundledAdapter().solve(simulation)


def one_grain(mesh: PrismMesh) -> PrismMesh:
    return replace(mesh, grain=np.zeros_like(mesh.grain))


def stiffness(material: Material, rotation: FloatArray) -> FloatArray:
    """Elastic stiffness [MPa] in the specimen frame, (3, 3, 3, 3)."""
    eye, cube = np.eye(3), np.einsum("ia,ja,ka,la->ijkl", *[rotation] * 4)
    volume = np.einsum("ij,kl->ijkl", eye, eye)
    shear = np.einsum("ik,jl->ijkl", eye, eye) + np.einsum("il,jk->ijkl", eye, eye)
    c11, c12, c44 = material.C11, material.C12, material.C44
    return np.asarray(c12 * volume + c44 * shear + (c11 - c12 - 2 * c44) * cube)


def test_a_patch_under_linear_motion_of_its_skin_strains_alike_to_rounding(
    kind: str, measure: StrainMeasure
) -> None:
    """The inner nodes follow the linear field, and the force is that of one Gauss point."""
    mesh = one_grain(BOXES[kind]((2, 2, 2), (2.0, 4.0, 2.0), jitter=0.2))
    gradient = np.array([[-0.4, 0.1, 0.0], [0.2, 1.0, 0.1], [0.0, -0.1, -0.3]]) * 0.004
    times = np.array([0.0, 1.0, 2.0, 3.0])

    def displacement(time: float, points: FloatArray) -> FloatArray:
        return time * points @ gradient.T

    material = Material(strain_measure=measure)
    simulation = moved(mesh, material, skin(mesh), displacement, times, tolerance=1e-12)
    response, problem = solve(simulation), build_problem(simulation)
    crystal, state = simulation.orientations[0], problem.state
    slips = np.zeros((len(state), 24))
    for row, time in enumerate(times[1:], start=1):
        expected = displacement(float(time), mesh.points)
        error = response.displacement[row] - expected
        assert abs(error).max() < 1e-12 * abs(expected).max()
        H = np.tile((time * gradient @ crystal).ravel(), (len(state), 1))
        state, slips, P, _, _ = problem.points.update(H, state, slips, 1.0)
        stress = (P[0].reshape(3, 3) @ crystal.T)[1, 1]
        np.testing.assert_allclose(response.force[row], 4.0 * stress, rtol=1e-9)
    assert np.count_nonzero(slips[0]) > 5


def _harmonic(material: Material, points: FloatArray) -> FloatArray:
    """A motion in elastic equilibrium: Re a exp(κ (m + p n)·x), Stroh's eigenvalue problem.

    Ting, Anisotropic Elasticity (1996), ch. 5: (Q + p (R + Rᵀ) + p² T) a = 0 with
    Q = C(m, m), R = C(m, n), T = C(n, n).
    """
    turn = rotation_vector_matrix(np.array([0.4, -0.7, 0.3]))
    m, n = turn[:, 0], turn[:, 1]
    C = stiffness(material, R)
    Q, S, T = (np.einsum("ijkl,j,l->ik", C, a, b) for a, b in ((m, m), (m, n), (n, n)))
    inverse = np.linalg.inv(T)
    N = np.block([[-inverse @ S.T, inverse], [S @ inverse @ S.T - Q, -S @ inverse]])
    roots, vectors = np.linalg.eig(N)
    pick = int(np.argmax(roots.imag))
    phase = 0.8 * (points @ m + roots[pick] * (points @ n))
    wave = np.exp(phase)[:, None] * vectors[:3, pick]
    return np.asarray(1e-6 * wave.real)


def test_displacements_of_an_anisotropic_crystal_converge_with_rate_three(kind: str) -> None:
    """Quadratic elements: error of u in L2 ~ h³, against an exact elastic solution."""
    material = Material(strain_measure="small")
    times = np.array([0.0, 1.0])
    shape = {"tet10": tet10_shape, "wedge15": wedge15_shape}[kind]
    spots = np.random.default_rng(7).dirichlet(np.ones(4), size=12)[:, :3]
    if kind == "wedge15":
        spots[:, 2] = np.linspace(-0.95, 0.95, 12)
    values, _ = shape(spots)
    errors = []
    for divisions in (2, 4, 6):
        mesh = one_grain(BOXES[kind]((divisions,) * 3, (2.0, 2.0, 2.0)))

        def displacement(time: float, points: FloatArray) -> FloatArray:
            return time * _harmonic(material, points)

        simulation = moved(mesh, material, skin(mesh), displacement, times)
        u = solve(replace(simulation, orientations=R[None])).displacement[1]
        at = np.einsum("qa,eai->eqi", values, mesh.points[mesh.cells]).reshape(-1, 3)
        found = np.einsum("qa,eai->eqi", values, u[mesh.cells]).reshape(-1, 3)
        errors.append(float(np.linalg.norm(found - _harmonic(material, at)) / len(at) ** 0.5))
    rates = np.log(np.divide(errors[:-1], errors[1:])) / np.log([4 / 2, 6 / 4])
    assert rates.min() > 2.8
    assert errors[-1] < 1e-3 * abs(_harmonic(material, at)).max()


def test_a_slender_beam_of_one_cell_through_its_depth_bends_exactly(kind: str) -> None:
    """No shear locking: pure bending of a turned cubic crystal, ends driven, sides free.

    σ_yy = k z strains by z E, E = S : (e_y ⊗ e_y) k, whose motion is
    u_i = E_ij x_j z − ½ δ_iz x·E·x.
    """
    material = Material(strain_measure="small")
    mesh = one_grain(BOXES[kind]((1, 8, 1), (1.0, 16.0, 1.0)))
    pairs = [(0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1)]
    C = stiffness(material, R)
    matrix = np.array([[C[(*row, *column)] for column in pairs] for row in pairs])
    strain = np.linalg.solve(matrix, np.eye(6)[1])  # σ_yy = 1 MPa/µm
    E = np.zeros((3, 3))
    for value, (i, j) in zip(strain, pairs, strict=True):
        E[i, j] = E[j, i] = value if i == j else value / 2

    def displacement(time: float, points: FloatArray) -> FloatArray:
        x = points - [0.5, 0.0, 0.5]
        u = x @ E.T * x[:, [2]]
        u[:, 2] -= 0.5 * np.einsum("ni,ij,nj->n", x, E, x)
        return np.asarray(time * u)

    ends = np.concatenate([mesh.nodes["S_MINUS"], mesh.nodes["S_PLUS"]])
    simulation = moved(mesh, material, ends, displacement, np.array([0.0, 1.0]), tolerance=1e-12)
    response = solve(replace(simulation, orientations=R[None]))
    exact = displacement(1.0, mesh.points)
    np.testing.assert_allclose(response.displacement[1], exact, atol=1e-9 * abs(exact).max())
    assert abs(response.force[1]) < 1e-9  # pure bending: 1/12 µN·µm and no force


def test_a_coarse_mesh_carries_little_more_than_a_fine_one_in_plastic_flow(kind: str) -> None:
    """Nearly incompressible flow of a clamped bar does not lock; the fine mesh is wedge15.

    Its 432 cells, of 4 × 8 × 4 bricks, carry 360.6 µN where 3 × 6 × 3 carry 363.6.
    """
    material = Material(strain_measure="small", c=0.0, K=5.0)
    mesh = one_grain(BOXES[kind]((2, 4, 2)))
    simulation = pulled(mesh, material, (0.002, 0.005, 0.01, 0.015), interval=10.0, tolerance=1e-7)
    force = solve(simulation).force
    assert force[4] < 1.01 * force[3]  # it flows
    assert 1.0 < force[4] / 360.6 < {"tet10": 1.045, "wedge15": 1.025}[kind]


def test_grains_of_one_orientation_are_one_grain(kind: str, measure: StrainMeasure) -> None:
    """Two and three grains by group; and the names of grains do not matter."""
    simulation = pulled(BOXES[kind]((1, 3, 1)), Material(strain_measure=measure), HISTORY)
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
        state, slips, P, _, count = problem.points.update(H, state, slips, 1.0)
        assert count.min() >= 0
    assert (np.count_nonzero(slips, axis=1) >= 5).all()
    stress = P.reshape(-1, 3, 3) @ turns.transpose(0, 2, 1)
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
        state, slips, P, _, count = problem.points.update(H, problem.state, rest, 1.0)
        assert count.min() > 0
        answers.append((state, slips, P.reshape(-1, 3, 3)))
    (state, slips, P), (state_q, slips_q, P_q) = answers
    assert (np.count_nonzero(slips, axis=1) >= 3).all()
    np.testing.assert_allclose(P_q, Q @ P, atol=1e-8 * abs(P).max())
    np.testing.assert_allclose(slips_q, slips, atol=1e-12)
    np.testing.assert_allclose(state_q, state, atol=1e-8 * abs(state).max())


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

    def answer(F: FloatArray) -> tuple[FloatArray, tuple[FloatArray, ...]]:
        H = np.tile((F - np.eye(3)).ravel() @ turn, (n, 1))
        end, new, P, C, count = problem.points.update(H, state, slips, 1.0, strained)
        residual = np.append((turn @ P[0])[free], gauge @ F.ravel()[free])
        solved = count[0] >= 0 and np.isfinite(residual).all()
        return residual if solved else np.full(7, np.inf), (end, new, P, C)

    F, rate = np.eye(3), np.zeros((3, 3))
    state, slips, before = problem.state, np.zeros((n, 24)), 1.0
    strained = np.zeros((n, 9))
    stresses, gradients = [], []
    for stretch in stretches:
        last = F
        F = F + rate * (stretch - before)
        F[:, 1] = [0.0, stretch, 0.0]
        residual, (end, new, P, C) = answer(F)
        for _ in range(60):
            if abs(residual).max() < 1e-7:
                break
            matrix = np.vstack([(turn @ C[0] @ turn.T)[np.ix_(free, free)], gauge])
            step = np.linalg.lstsq(matrix, residual, rcond=None)[0]
            for length in 0.5 ** np.arange(12):
                trial = F.copy()
                trial.ravel()[free] -= length * step
                changed, answered = answer(trial)
                if np.linalg.norm(changed) < np.linalg.norm(residual):
                    break
            F, residual, (end, new, P, C) = trial, changed, answered
        assert abs(residual).max() < 1e-7
        rate, before = (F - last) / (stretch - before), stretch
        state, slips = end, new
        strained = np.tile((F - np.eye(3)).ravel() @ turn, (n, 1))
        stresses.append((turn @ P[0])[4])
        gradients.append(F)
    return np.array(stresses), np.array(gradients)


def _pulled_point(material: Material, orientation: FloatArray) -> Simulation:
    simulation = pulled(one_grain(BOXES["tet10"]((1, 1, 1))), material, HISTORY)
    return replace(simulation, orientations=orientation[None])


def test_slip_begins_at_the_stress_of_the_largest_schmid_factor(measure: StrainMeasure) -> None:
    """Elastic at 99.7 % of τ0/μ, plastic from 101 % on, for several orientations."""
    material = Material(strain_measure=measure, c=0.0, K=1e-2)
    for angles in ((0.3, 0.2, 0.1), (1.0, -0.5, 0.4), (-0.2, 0.9, 2.0)):
        orientation = rotation_vector_matrix(np.array(angles))
        axis = orientation.T @ [0.0, 1.0, 0.0]
        factors = abs(np.einsum("i,sij,j->s", axis, schmid_tensors(), axis))
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


def test_the_lattice_of_a_crystal_in_single_slip_turns_by_the_law_of_schmid_and_boas() -> None:
    """Tension along a material line: sin λ = sin λ0 · l0/l, λ from the axis to the slip direction.

    Schmid and Boas, Kristallplastizität (1935), for a rigid lattice: hence the tolerance, of the
    size of the elastic strain.
    """
    material = Material(strain_measure="finite", c=0.0)
    directions, normals = slip_systems()
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
    assert np.arcsin(sine) - expected > 0.08


def _slip_of(F: FloatArray, m: FloatArray, n: FloatArray) -> float:
    """Slip γ for which F (I − γ m ⊗ n) is nearest to a rotation."""
    low = float(np.einsum("i,ij,j->", m, F.T @ F, n))
    return low / float(np.einsum("i,ij,j->", m, F.T @ F, m))


def test_derivatives_of_a_mesh_of_wedges_are_difference_quotients(measure: StrainMeasure) -> None:
    """Along a constant, the motion, the crystals and the nodes (tetrahedra: test_sensitivities)."""
    simulation = pulled(
        BOXES["wedge15"](), Material(strain_measure=measure), HISTORY, tolerance=1e-12
    )
    rotation = np.array([[0.3, -0.2, 0.5], [0.1, 0.4, -0.3]])
    points = 0.1 * np.sin(simulation.mesh.points[:, [1, 2, 0]])
    directions = (
        Direction("tau0", material={"tau0": 1.0}),
        Direction("motion", motion=simulation.motion),
        Direction("rotation", rotation=rotation),
        Direction("points", points=points),
    )
    response = solve(replace(simulation, directions=directions))

    def along(name: str, step: float) -> FloatArray:
        s = simulation
        if name == "tau0":
            s = replace(s, material=replace(s.material, tau0=s.material.tau0 + step))
        elif name == "motion":
            s = replace(s, motion=(1 + step) * s.motion)
        elif name == "rotation":
            turns = np.array([rotation_vector_matrix(step * vector) for vector in rotation])
            s = replace(s, orientations=turns @ s.orientations)
        else:
            s = replace(s, mesh=replace(s.mesh, points=s.mesh.points + step * points))
        return solve(s).force

    for row, (name, step) in enumerate(
        [("tau0", 1e-3), ("motion", 1e-5), ("rotation", 1e-5), ("points", 1e-5)]
    ):
        expected = (along(name, step) - along(name, -step)) / (2 * step)
        found = response.d_force[row]
        np.testing.assert_allclose(found, expected, atol=1e-5 * abs(expected).max(), err_msg=name)


def test_the_equilibrium_iteration_converges_quadratically(
    kind: str, measure: StrainMeasure
) -> None:
    """Residual norms of a plastic step that starts from the last displacement: order > 1.8."""
    simulation = pulled(BOXES[kind](), Material(strain_measure=measure), (0.004,))
    floor = 5e-8  # µN: the force that an error of SLIP_TOLERANCE in the slips makes
    problem = build_problem(simulation)
    points, free = problem.points, problem.pattern.free
    solver = SymmetricSolver(problem.pattern.indptr, problem.pattern.indices)
    u, state = np.zeros((problem.n_nodes, 3)), problem.state
    rate, before = np.zeros_like(u), 0.0
    for part in (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.05):
        last = u.copy()
        u += rate * (part - before) if part <= 1.0 else 0.0
        u.ravel()[problem.prescribed] = part * problem.motion[1]
        slips = np.zeros((len(state), 24))
        norms: list[float] = []
        while len(norms) < 25:
            H = np.empty((len(state), 9))
            displacement_gradients(u, problem.cells, problem.gradients, H)
            end, slips, P, C, count = points.update(H, state, slips, 1.0)
            assert count.min() >= 0
            forces = np.empty(problem.pattern.dofs.shape)
            element_forces(P, problem.gradients, problem.weights, forces)
            residual = problem.pattern.node_sum(forces, problem.n_nodes)[free]
            norms.append(float(np.linalg.norm(residual)))
            if norms[-1] < floor:
                break
            K = np.empty(problem.pattern.slots.shape)
            element_stiffness(C, problem.gradients, problem.weights, K)
            solver.factor(problem.pattern.values(K))
            u.ravel()[free] -= solver.solve(residual)
        assert norms[-1] < floor
        rate, before, state = (u - last) / (part - before), part, end
    slopes = np.diff(np.log([norm for norm in norms if norm > floor]))
    assert slopes[-1] / slopes[-2] > 1.8
