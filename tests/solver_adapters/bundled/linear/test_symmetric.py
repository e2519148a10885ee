"""Every solution is checked: right, mended by the fallback, or an error."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp

from meshes.arrays import FloatArray
from solver_adapters.bundled.linear import residual_check, superlu
from solver_adapters.bundled.linear.residual_check import LinearSolverError
from solver_adapters.bundled.linear.split_matrix import LARGEST_RESIDUAL, RESIDUAL
from solver_adapters.bundled.linear.superlu import SuperLU
from solver_adapters.bundled.linear.symmetric import SymmetricSolver, iterations_for_factor
from solver_adapters.cholesky import Cholesky
from solver_adapters.cholmod import cholmod
from tests.solver_adapters.bundled.matrices import (
    N,
    chain,
    indefinite,
    lower_triangle,
    pattern,
    positive_definite,
    right_hand_sides,
    soft,
)


def _solver(full: Any) -> SymmetricSolver:
    return SymmetricSolver(*pattern(full))


def _factored(full: Any) -> SymmetricSolver:
    solver = _solver(full)
    solver.factor(lower_triangle(full).data)
    return solver


def test_a_positive_definite_system_has_the_dense_solution() -> None:
    full = positive_definite()
    solver = _factored(full)
    expected = np.linalg.solve(full.toarray(), right_hand_sides(N))
    np.testing.assert_allclose(solver.solve(right_hand_sides(N)), expected, rtol=1e-12)
    assert solver.fallbacks == 0


@pytest.mark.parametrize("order", ["C", "F"])
def test_many_right_hand_sides_have_the_dense_solutions(order: Any) -> None:
    full = positive_definite()
    rhs = np.array(right_hand_sides(N, 24), order=order)
    rhs[:, 5] = 0.0
    solution = _factored(full).solve(rhs)
    np.testing.assert_allclose(solution, np.linalg.solve(full.toarray(), rhs), rtol=1e-12)
    assert not solution[:, 5].any()


def test_no_right_hand_side_has_no_solution() -> None:
    assert _factored(positive_definite()).solve(np.zeros((N, 0))).shape == (N, 0)


def test_the_right_hand_side_is_left_as_it_was() -> None:
    rhs = right_hand_sides(N)
    _factored(positive_definite()).solve(rhs)
    np.testing.assert_array_equal(rhs, right_hand_sides(N))


def test_new_values_on_the_same_pattern_give_the_new_solution() -> None:
    full = positive_definite()
    solver = _factored(full)
    scale = sp.diags_array(np.linspace(1.0, 3.0, N))
    other = scale @ full @ scale
    solver.factor(lower_triangle(other).data)
    expected = np.linalg.solve(other.toarray(), right_hand_sides(N))
    np.testing.assert_allclose(solver.solve(right_hand_sides(N)), expected, rtol=1e-12)
    assert solver.fallbacks == 0


def test_values_changed_by_the_caller_after_the_factorisation_have_no_effect() -> None:
    full = positive_definite()
    values = lower_triangle(full).data
    solver = _solver(full)
    solver.factor(values)
    values[:] = -1.0
    expected = np.linalg.solve(full.toarray(), right_hand_sides(N))
    np.testing.assert_allclose(solver.solve(right_hand_sides(N)), expected, rtol=1e-12)


def test_an_indefinite_system_is_solved_by_the_fallback_and_counted() -> None:
    full = indefinite()
    eigenvalues = np.linalg.eigvalsh(full.toarray())
    assert eigenvalues[0] < 0 < eigenvalues[-1]
    solver = _factored(full)
    for rhs in (right_hand_sides(N), right_hand_sides(N, 3)):
        expected = np.linalg.solve(full.toarray(), rhs)
        np.testing.assert_allclose(solver.solve(rhs), expected, rtol=1e-10)
    assert solver.fallbacks == 1


def test_after_an_indefinite_matrix_the_cholesky_factor_serves_again() -> None:
    full = positive_definite()
    solver = _solver(full)
    solver.factor(-lower_triangle(full).data)
    solver.factor(lower_triangle(full).data)
    expected = np.linalg.solve(full.toarray(), right_hand_sides(N))
    np.testing.assert_allclose(solver.solve(right_hand_sides(N)), expected, rtol=1e-12)
    assert solver.fallbacks == 1


@pytest.mark.parametrize("seed", range(5))
def test_a_singular_matrix_raises_although_rounding_hides_it(seed: int) -> None:
    stiffness = np.random.default_rng(seed).uniform(0.1, 10.0, N)
    with pytest.raises(LinearSolverError, match="singular"):
        _factored(chain(stiffness))


def test_a_matrix_of_zeros_raises() -> None:
    solver = _solver(positive_definite())
    with pytest.raises(LinearSolverError, match="singular"):
        solver.factor(np.zeros(lower_triangle(positive_definite()).nnz))


def test_after_a_failed_factorisation_there_is_nothing_to_solve_with() -> None:
    full = positive_definite()
    solver = _factored(full)
    with pytest.raises(LinearSolverError):
        solver.factor(np.zeros(lower_triangle(full).nnz))
    with pytest.raises(RuntimeError, match="factor first"):
        solver.solve(right_hand_sides(N))


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_value_that_is_not_finite_raises(bad: float) -> None:
    full = positive_definite()
    values = lower_triangle(full).data
    values[3] = bad
    with pytest.raises(LinearSolverError, match="not finite"):
        _solver(full).factor(values)
    with pytest.raises(LinearSolverError, match="not finite"):
        _factored(full).solve(np.full(N, bad))


def test_a_wrong_number_of_values_raises() -> None:
    full = positive_definite()
    with pytest.raises(ValueError, match="one for each entry"):
        _solver(full).factor(full.data)


@pytest.mark.parametrize("shape", [(N + 1,), (3, N), ()])
def test_a_right_hand_side_of_another_size_raises(shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="right-hand side: found shape"):
        _factored(positive_definite()).solve(np.zeros(shape))


def _noise(_factor: Any, x: Any) -> None:
    np.asarray(x)[:] = 1e200 * right_hand_sides(*x.size)


def _not_a_number(_factor: Any, x: Any) -> None:
    np.asarray(x)[:] = np.nan


def _nothing(_factor: Any, x: Any) -> None:
    np.asarray(x)[:] = 0.0


@pytest.mark.parametrize("spoiled", [_noise, _not_a_number, _nothing])
def test_garbage_from_the_cholesky_factor_is_caught_and_mended(
    monkeypatch: pytest.MonkeyPatch, spoiled: Callable[[Any, Any], None]
) -> None:
    full = positive_definite()
    solver = _factored(full)
    monkeypatch.setattr(cholmod, "solve", spoiled)
    for rhs in (right_hand_sides(N), right_hand_sides(N, 3)):
        expected = np.linalg.solve(full.toarray(), rhs)
        np.testing.assert_allclose(solver.solve(rhs), expected, rtol=1e-10)
    assert solver.fallbacks == 1


def test_garbage_in_one_column_of_many_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    full = positive_definite()
    original = Cholesky.solve

    def spoiled(cholesky: Cholesky, rhs: FloatArray) -> FloatArray:
        solution = original(cholesky, rhs)
        solution[20, -1] += 1.0
        return solution

    monkeypatch.setattr(Cholesky, "solve", spoiled)
    solver = _factored(full)
    rhs = right_hand_sides(N, 24)
    expected = np.linalg.solve(full.toarray(), rhs)
    np.testing.assert_allclose(solver.solve(rhs), expected, rtol=1e-10)
    assert solver.fallbacks == 1


@pytest.mark.parametrize(("change", "fallbacks"), [(1e-5, 0), (3.0, 1)])
def test_a_factor_of_older_values_is_refined_if_near_and_replaced_if_far(
    monkeypatch: pytest.MonkeyPatch, change: float, fallbacks: int
) -> None:
    full = positive_definite()
    solver = _factored(full)
    monkeypatch.setattr(cholmod, "numeric", lambda *_: None)
    other = full + change * sp.diags_array(np.linspace(0.0, 1.0, N) * full.diagonal())
    solver.factor(lower_triangle(other).data)
    expected = np.linalg.solve(other.toarray(), right_hand_sides(N))
    np.testing.assert_allclose(solver.solve(right_hand_sides(N)), expected, rtol=1e-9)
    assert solver.fallbacks == fallbacks


def test_a_system_that_no_backend_solves_raises(monkeypatch: pytest.MonkeyPatch) -> None:
    class Spoiled:
        U = sp.eye_array(N)
        perm_c = np.arange(N)

        @staticmethod
        def solve(rhs: FloatArray) -> FloatArray:
            return np.ones_like(rhs)

    solver = _factored(positive_definite())
    monkeypatch.setattr(cholmod, "solve", _nothing)
    monkeypatch.setattr(superlu, "splu", lambda *_args, **_options: Spoiled())
    with pytest.raises(LinearSolverError, match="relative residual"):
        solver.solve(right_hand_sides(N))


@pytest.mark.parametrize("scale", [1e-200, 1e200])
def test_the_size_of_the_right_hand_side_does_not_matter(scale: float) -> None:
    full = positive_definite()
    rhs = scale * right_hand_sides(N, 3)
    expected = np.linalg.solve(full.toarray(), rhs)
    np.testing.assert_allclose(_factored(full).solve(rhs), expected, rtol=1e-12)


def test_an_ill_conditioned_system_is_solved_as_well_as_rounding_allows() -> None:
    full = soft(1e9)
    solver = _factored(full)
    for rhs in (np.ones(N), 1.0 + 0.1 * right_hand_sides(N, 5)):
        solution = solver.solve(rhs)
        residual = np.linalg.norm(full @ solution - rhs) / np.linalg.norm(rhs)
        assert RESIDUAL < residual < LARGEST_RESIDUAL
        np.testing.assert_allclose(solution, np.linalg.solve(full.toarray(), rhs), rtol=1e-6)
    assert solver.fallbacks == 0


def test_a_solution_that_rounding_does_not_excuse_raises_however_ill_the_condition(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    original = Cholesky.solve
    monkeypatch.setattr(Cholesky, "solve", lambda *a: original(*a) * (1 + 1e-6))
    monkeypatch.setattr(residual_check, "REFINEMENTS", 0)
    solver = _factored(soft(1e8))
    monkeypatch.setattr(SuperLU, "factor", lambda _: solver._cholesky.solve)
    with pytest.raises(LinearSolverError, match=r"relative residual 1\.0e-06"):
        solver.solve(np.ones(N))


def test_a_matrix_as_good_as_singular_raises() -> None:
    solver = _factored(soft(1e12))
    with pytest.raises(LinearSolverError, match="relative residual"):
        solver.solve(1.0 + 0.1 * right_hand_sides(N))


def _drifting(step: int) -> Any:
    """A matrix that drifts away, as a tangent does from one time step to the next."""
    full = positive_definite()
    return full + 0.1 * step * sp.diags_array(np.linspace(0.0, 1.0, N) * full.diagonal())


@pytest.mark.parametrize("accuracy", [1e-2, 1e-6, 1e-10])
def test_after_an_update_the_new_system_is_solved_with_the_old_factor(accuracy: float) -> None:
    solver = _factored(_drifting(0))
    full, rhs = _drifting(1), right_hand_sides(N)
    solver.update(lower_triangle(full).data)
    solution = solver.solve(rhs, accuracy)
    assert np.linalg.norm(full @ solution - rhs) <= accuracy * np.linalg.norm(rhs)
    assert solver.factorisations == 1
    assert 0 < solver.iterations < iterations_for_factor(N)


def test_an_update_without_a_factor_makes_one() -> None:
    full, rhs = positive_definite(), right_hand_sides(N)
    solver = _solver(full)
    solver.update(lower_triangle(full).data)
    np.testing.assert_allclose(solver.solve(rhs), np.linalg.solve(full.toarray(), rhs), rtol=1e-12)
    assert (solver.factorisations, solver.iterations) == (1, 0)


def test_many_right_hand_sides_after_an_update_get_a_new_factor() -> None:
    solver = _factored(_drifting(0))
    full, rhs = _drifting(3), right_hand_sides(N, 2)
    solver.update(lower_triangle(full).data)
    np.testing.assert_allclose(solver.solve(rhs), np.linalg.solve(full.toarray(), rhs), rtol=1e-12)
    assert (solver.factorisations, solver.iterations) == (2, 0)


def test_a_factor_too_far_is_replaced() -> None:
    solver = _factored(positive_definite())
    scale = sp.diags_array(np.linspace(1.0, 100.0, N))
    full, rhs = scale @ positive_definite() @ scale, right_hand_sides(N)
    solver.update(lower_triangle(full).data)
    np.testing.assert_allclose(solver.solve(rhs), np.linalg.solve(full.toarray(), rhs), rtol=1e-10)
    assert solver.factorisations == 2


def test_a_factor_wears_out_and_the_work_stays_below_that_of_factoring_every_time() -> None:
    solver, steps = _factored(_drifting(0)), 60
    for step in range(1, steps + 1):
        full, rhs = _drifting(step), right_hand_sides(N)
        solver.update(lower_triangle(full).data)
        solution = solver.solve(rhs, 1e-3)
        assert np.linalg.norm(full @ solution - rhs) <= 1e-3 * np.linalg.norm(rhs)
    assert 1 < solver.factorisations < steps / 4
    price = iterations_for_factor(N)
    assert price * solver.factorisations + solver.iterations < price * steps / 2


def test_an_update_to_an_indefinite_matrix_ends_in_the_fallback() -> None:
    solver = _factored(positive_definite())
    full, rhs = indefinite(), right_hand_sides(N)
    solver.update(lower_triangle(full).data)
    np.testing.assert_allclose(solver.solve(rhs), np.linalg.solve(full.toarray(), rhs), rtol=1e-10)
    assert (solver.factorisations, solver.fallbacks) == (2, 1)
    solver.update(lower_triangle(positive_definite()).data)
    expected = np.linalg.solve(positive_definite().toarray(), rhs)
    np.testing.assert_allclose(solver.solve(rhs), expected, rtol=1e-10)
    assert (solver.factorisations, solver.fallbacks) == (3, 1)


def test_an_update_to_a_singular_matrix_raises() -> None:
    regular = chain(np.ones(N - 1)) + sp.eye_array(N)
    solver = _factored(regular)
    solver.update(lower_triangle(chain(np.ones(N - 1))).data)
    with pytest.raises(LinearSolverError, match="singular"):
        solver.solve(right_hand_sides(N))
    with pytest.raises(RuntimeError, match="factor first"):
        solver.solve(right_hand_sides(N))


def test_the_same_updates_give_the_same_digits() -> None:
    solutions = []
    for _ in range(2):
        solver = _factored(_drifting(0))
        for step in range(1, 20):
            solver.update(lower_triangle(_drifting(step)).data)
            solution = solver.solve(right_hand_sides(N), 1e-3)
        solutions.append(solution)
    np.testing.assert_array_equal(solutions[0], solutions[1])


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_an_update_that_is_not_finite_raises_and_leaves_nothing_to_solve_with(bad: float) -> None:
    full = positive_definite()
    solver = _factored(full)
    values = lower_triangle(full).data
    values[3] = bad
    with pytest.raises(LinearSolverError, match="not finite"):
        solver.update(values)
    with pytest.raises(RuntimeError, match="factor first"):
        solver.solve(right_hand_sides(N))


def test_a_loose_accuracy_costs_no_refinement_and_a_tight_one_is_met() -> None:
    full, rhs = positive_definite(), right_hand_sides(N)
    for accuracy in (1e-2, 1e-15):
        solution = _factored(full).solve(rhs, accuracy)
        np.testing.assert_allclose(solution, np.linalg.solve(full.toarray(), rhs), rtol=1e-12)
