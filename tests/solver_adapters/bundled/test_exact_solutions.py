"""Both elements against what is known exactly, or by a convergence rate.

The material is that of the paper unless a test says otherwise.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from meshes import hex20, tet10
from meshes.arrays import FloatArray
from solver_adapters.bundled.adapter import BundledAdapter
from solver_adapters.bundled.fem.problem import build_problem
from solver_adapters.crystal import rotation_vector_matrix
from solver_adapters.interface import Response, Simulation
from solver_adapters.material import Material, StrainMeasure
from tests.solver_adapters.bundled.elasticity import stiffness
from tools.boxes import BOXES, ORIENTATIONS, moved, one_grain, pulled, skin

R = ORIENTATIONS[1]


def solve(simulation: Simulation) -> Response:
    return BundledAdapter().solve(simulation)


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
        found = problem.points.update(H, state, slips, 1.0)
        state, slips = found.state, found.slips
        stress = (found.P[0].reshape(3, 3) @ crystal.T)[1, 1]
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
    shape = {"tet10": tet10, "hex20": hex20}[kind].shape_functions
    rng = np.random.default_rng(7)
    spots = rng.dirichlet(np.ones(4), size=12)[:, :3]
    if kind == "hex20":
        spots = rng.uniform(-0.95, 0.95, (12, 3))
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
    # A column of hexahedra one wide across its width, too, would move without strain.
    wide = {"tet10": 1, "hex20": 2}[kind]
    mesh = one_grain(BOXES[kind]((wide, 8, 1), (1.0, 16.0, 1.0)))
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
    """Nearly incompressible flow of a clamped bar does not lock; the fine mesh is hex20.

    Its 128 cells, 4 × 8 × 4, carry 358.98 µN where 3 × 6 × 3 carry 361.07.
    """
    material = Material(strain_measure="small", c=0.0, K=5.0)
    mesh = one_grain(BOXES[kind]((2, 4, 2)))
    simulation = pulled(mesh, material, (0.002, 0.005, 0.01, 0.015), interval=10.0, tolerance=1e-7)
    force = solve(simulation).force
    assert force[4] < 1.01 * force[3]  # it flows
    assert 1.0 < force[4] / 358.98 < {"tet10": 1.047, "hex20": 1.02}[kind]
