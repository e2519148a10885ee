"""The linear systems of a run against dense sums and SciPy, and Newton's method with them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import solve

from meshes.arrays import FloatArray, IntArray
from solver_adapters.bundled import tangent_system
from solver_adapters.bundled.fem.assembly import displacement_gradients, element_forces
from solver_adapters.bundled.fem.problem import Problem, build_problem
from solver_adapters.bundled.linear.split_matrix import Backsolve
from solver_adapters.bundled.linear.superlu import SuperLU
from solver_adapters.bundled.linear.symmetric import SymmetricSolver
from solver_adapters.bundled.statistics import Statistics
from solver_adapters.bundled.tangent_system import TangentSystem
from solver_adapters.cholesky import Cholesky
from solver_adapters.material import Material, StrainMeasure
from tests.solver_adapters.bundled.elasticity import stiffness
from tools.boxes import BOXES, pulled

LAWS = {
    "symmetric": Material(),
    "non-Schmid": Material(a1=0.3),
    "latent": Material(Q=10.0, h_latent=1.4),
}


def _problem(law: str, kind: str) -> Problem:
    return build_problem(pulled(BOXES[kind](), LAWS[law], (0.0,)))


def _tangents(problem: Problem, skew: float, seed: int = 0) -> FloatArray:
    """Tangents near the elastic ones, with a part that is not symmetric."""
    rng = np.random.default_rng(seed)
    n = problem.points.grain.size
    elastic = stiffness(Material(), np.eye(3)).reshape(9, 9)
    noise = 2e3 * rng.normal(size=(n, 9, 9))
    noise += noise.transpose(0, 2, 1)
    part = skew * rng.normal(size=(n, 9, 9))
    return np.asarray(elastic + noise + part - part.transpose(0, 2, 1))


def _dense(problem: Problem, C: FloatArray) -> FloatArray:
    """∫ G C G on the free degrees of freedom, by sums over the cells."""
    n_cells, n_gauss, n, _ = problem.gradients.shape
    tensors = C.reshape(n_cells, n_gauss, 3, 3, 3, 3)
    blocks = np.einsum(
        "eq,eqaj,eqijkl,eqbl->eaibk", problem.weights, problem.gradients, tensors, problem.gradients
    )
    whole = np.zeros((3 * problem.n_nodes, 3 * problem.n_nodes))
    dofs = (3 * problem.cells[:, :, None] + np.arange(3)).reshape(n_cells, -1)
    for rows, block in zip(dofs, blocks.reshape(n_cells, 3 * n, 3 * n), strict=True):
        whole[np.ix_(rows, rows)] += block
    free = problem.pattern.free
    return whole[np.ix_(free, free)]


@pytest.mark.parametrize("law", LAWS)
def test_solutions_are_those_of_the_dense_stiffness(law: str, kind: str) -> None:
    """One column and several, whether the tangent is symmetric or not."""
    problem = _problem(law, kind)
    C = _tangents(problem, 0.0 if law == "symmetric" else 3e3)
    system = TangentSystem(problem, Statistics())
    system.assemble(C, moves=True, columns=1)
    rhs = np.random.default_rng(1).normal(size=(problem.pattern.free.size, 3))
    expected = solve(_dense(problem, C), rhs)
    for found, exact in ((system.solve(rhs), expected), (system.solve(rhs[:, 0]), expected[:, 0])):
        np.testing.assert_allclose(found, exact, atol=1e-8 * abs(exact).max())


@pytest.mark.parametrize(("most_with_two", "count"), [(0, 1), (10**9, 2)])
def test_of_many_unknowns_one_factor_is_kept(
    most_with_two: int, count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = []

    def solver(*shape: IntArray) -> SymmetricSolver:
        made.append(shape)
        return SymmetricSolver(*shape)

    monkeypatch.setattr(tangent_system, "MOST_WITH_TWO", most_with_two)
    monkeypatch.setattr(tangent_system, "SymmetricSolver", solver)
    TangentSystem(_problem("symmetric", "tet10"), Statistics())
    assert len(made) == count


def test_without_symmetry_the_factor_suits_as_many_columns_as_are_to_come(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """More than the iteration was too slow for leave no factor of the symmetric part to be made."""
    problem = _problem("non-Schmid", "tet10")
    made: list[str] = []
    part, whole = Cholesky.factor, SuperLU.factor

    def of_part(solver: Cholesky) -> bool:
        made.append("part")
        return part(solver)

    def of_whole(solver: SuperLU) -> Backsolve:
        made.append("whole")
        return whole(solver)

    monkeypatch.setattr(Cholesky, "factor", of_part)
    monkeypatch.setattr(SuperLU, "factor", of_whole)
    C = _tangents(problem, 3e4)
    system = TangentSystem(problem, Statistics())
    rhs = np.random.default_rng(1).normal(size=(problem.pattern.free.size, 90))
    expected = solve(_dense(problem, C), rhs)
    for columns in (90, 90, 0):
        system.assemble(C, True, columns)
        found = system.solve(rhs[:, : max(columns, 1)])
        exact = expected[:, : max(columns, 1)]
        np.testing.assert_allclose(found, exact, atol=1e-8 * abs(exact).max())
    assert made == ["part", "whole", "whole", "part"]


@pytest.mark.parametrize("most_with_two", [0, tangent_system.MOST_WITH_TWO])
@pytest.mark.parametrize("columns", [1, 0])
def test_the_last_tangent_counts_whatever_was_factored_before(
    columns: int, most_with_two: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Moves and holds in turn, with old factors or new ones, each time another matrix."""
    monkeypatch.setattr(tangent_system, "MOST_WITH_TWO", most_with_two)
    problem = _problem("symmetric", "tet10")
    system = TangentSystem(problem, Statistics())
    rhs = np.random.default_rng(1).normal(size=problem.pattern.free.size)
    for seed, moves in enumerate((True, False, True, True, False)):
        C = (1.0 + seed) * _tangents(problem, 0.0, seed)
        system.assemble(C, moves, columns)
        expected = solve(_dense(problem, C), rhs)
        np.testing.assert_allclose(system.solve(rhs), expected, atol=1e-8 * abs(expected).max())


def test_a_rough_solution_has_the_residual_that_was_asked() -> None:
    """An old factor leads to the residual; one of a matrix twice as large is off by a half."""
    problem = _problem("symmetric", "tet10")
    system = TangentSystem(problem, Statistics())
    rhs = np.random.default_rng(1).normal(size=problem.pattern.free.size)
    system.assemble(2.0 * _tangents(problem, 0.0, 1), moves=True, columns=1)
    C = _tangents(problem, 0.0, 2)
    matrix = _dense(problem, C)
    for accuracy in (1e-3, 1e-8):
        system.assemble(C, moves=True, columns=0)
        residual = rhs - matrix @ system.solve(rhs, accuracy)
        assert np.linalg.norm(residual) <= accuracy * np.linalg.norm(rhs)


@pytest.mark.parametrize("measure", ["small", "finite"])
@pytest.mark.parametrize("a1", [0.0, 0.3])
def test_a_plastic_tangent_after_an_elastic_one_has_its_projected_dilatation(
    a1: float, measure: StrainMeasure, kind: str
) -> None:
    material = Material(strain_measure=measure, a1=a1)
    problem = build_problem(
        replace(pulled(BOXES[kind](), material, (0.004,)), mean_dilatation=True)
    )
    system, n = TangentSystem(problem, Statistics()), problem.points.grain.size
    rng = np.random.default_rng(4)
    u = np.zeros((problem.n_nodes, 3))
    for scale in (0.0, 5e-4):
        u = scale * rng.normal(size=u.shape)
        found = problem.points.update(problem.strain(u), problem.state, np.zeros((n, 24)), 1.0)
        assert found.iterations.min() >= 0
        system.assemble(found.C, moves=True, columns=1)
    assert np.count_nonzero(found.slips) > 0
    x, free = np.zeros((problem.n_nodes, 3)), problem.pattern.free
    rhs = rng.normal(size=free.size)
    x.ravel()[free] = system.solve(rhs)
    image = problem.forces(np.einsum("pij,pj->pi", found.C, problem.strain(x)))[free]
    np.testing.assert_allclose(image, rhs, rtol=0, atol=1e-9 * float(np.linalg.norm(rhs)))


def test_every_part_of_the_work_is_booked() -> None:
    problem, statistics = _problem("symmetric", "tet10"), Statistics()
    system = TangentSystem(problem, statistics)
    system.assemble(_tangents(problem, 0.0), moves=False, columns=1)
    assert set(statistics.seconds) == {"assembly", "factorisation"}
    system.solve(np.ones(problem.pattern.free.size))
    assert set(statistics.seconds) == {"assembly", "factorisation", "solution"}
    assert min(statistics.seconds.values()) > 0.0


def test_the_equilibrium_iteration_converges_quadratically(
    kind: str, measure: StrainMeasure
) -> None:
    """Residual norms of a plastic step that starts from the last displacement: order > 1.8."""
    simulation = pulled(BOXES[kind](), Material(strain_measure=measure), (0.004,))
    floor = 5e-8  # µN: the force that an error of SLIP_TOLERANCE in the slips makes
    problem = build_problem(simulation)
    system = TangentSystem(problem, Statistics())
    points, free = problem.points, problem.pattern.free
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
            found = points.update(H, state, slips, 1.0)
            assert found.iterations.min() >= 0
            slips = found.slips
            forces = np.empty(problem.pattern.dofs.shape)
            element_forces(found.P, problem.gradients, problem.weights, forces)
            residual = problem.pattern.node_sum(forces, problem.n_nodes)[free]
            norms.append(float(np.linalg.norm(residual)))
            if norms[-1] < floor:
                break
            system.assemble(found.C, moves=True, columns=1)
            u.ravel()[free] -= system.solve(residual)
        assert norms[-1] < floor
        rate, before, state = (u - last) / (part - before), part, found.state
    slopes = np.diff(np.log([norm for norm in norms if norm > floor]))
    assert slopes[-1] / slopes[-2] > 1.8
