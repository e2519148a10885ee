"""Unsymmetric systems have their own true solution, by the iteration, by SuperLU, or an error."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp

from meshes.arrays import FloatArray
from solver_adapters.bundled.linear import superlu
from solver_adapters.bundled.linear.residual_check import LinearSolverError
from solver_adapters.bundled.linear.split_matrix import LARGEST_RESIDUAL, RESIDUAL
from solver_adapters.bundled.linear.unsymmetric import UnsymmetricSolver
from solver_adapters.cholesky import Cholesky
from tests.solver_adapters.bundled.matrices import (
    N,
    antisymmetric,
    chain,
    indefinite,
    lower_triangle,
    pattern,
    positive_definite,
    right_hand_sides,
    soft,
    values_on,
)

SHAPES = [(N,), (N, 1), (N, 12)]


def _factored(symmetric: Any, skew: Any) -> UnsymmetricSolver:
    solver = UnsymmetricSolver(*pattern(symmetric))
    solver.factor(lower_triangle(symmetric).data, values_on(symmetric, skew))
    return solver


def _dense_solution(symmetric: Any, skew: Any, rhs: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.solve((symmetric + skew).toarray(), rhs))


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("size", [0.0, 1e-6, 1e-3, 1e-2])
def test_the_solution_is_that_of_the_whole_without_its_factor(
    size: float, shape: tuple[int, ...]
) -> None:
    symmetric = positive_definite()
    skew, rhs = antisymmetric(symmetric, size), right_hand_sides(*shape)
    solver = _factored(symmetric, skew)
    expected = _dense_solution(symmetric, skew, rhs)
    np.testing.assert_allclose(solver.solve(rhs), expected, rtol=1e-7, atol=1e-12)
    assert solver.fallbacks == 0
    assert solver.iterations <= 6


def test_the_transposed_system_has_another_solution() -> None:
    symmetric = positive_definite()
    skew, rhs = antisymmetric(symmetric, 0.3), right_hand_sides(N)
    solver = UnsymmetricSolver(*pattern(symmetric))
    for sign in (1.0, -1.0):
        solver.factor(lower_triangle(symmetric).data, sign * values_on(symmetric, skew))
        expected = _dense_solution(symmetric, sign * skew, rhs)
        np.testing.assert_allclose(solver.solve(rhs), expected, rtol=1e-7)
    assert solver.fallbacks == 0


@pytest.mark.parametrize("shape", SHAPES)
def test_a_dominating_antisymmetric_part_is_left_to_superlu(shape: tuple[int, ...]) -> None:
    symmetric = positive_definite()
    skew, rhs = antisymmetric(symmetric, 1e3), right_hand_sides(*shape)
    solver = _factored(symmetric, skew)
    for _ in range(2):
        expected = _dense_solution(symmetric, skew, rhs)
        np.testing.assert_allclose(solver.solve(rhs), expected, rtol=1e-9, atol=1e-12)
    assert (solver.fallbacks, solver.iterations) == (1, 0)


def test_the_whole_is_factored_at_once_for_columns_that_the_iteration_was_too_slow_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Fewer of them and single ones are iterated to as before."""
    symmetric = positive_definite()
    rhs = right_hand_sides(N, 60)
    solver, plain = UnsymmetricSolver(*pattern(symmetric)), Cholesky.factor
    factored: list[Cholesky] = []

    def watched(cholesky: Cholesky) -> bool:
        factored.append(cholesky)
        return plain(cholesky)

    monkeypatch.setattr(Cholesky, "factor", watched)
    # Columns; then how often SuperLU and CHOLMOD have factored, and whether there are iterations.
    calls = ((60, 1, 1, False), (60, 2, 1, False), (4, 2, 2, True), (1, 2, 3, True))
    for call, (columns, fallbacks, factors, iterates) in enumerate(calls):
        skew = antisymmetric(symmetric, 0.1 if call < 2 else 0.03)
        before = solver.iterations
        solver.factor(lower_triangle(symmetric).data, values_on(symmetric, skew), columns)
        found = solver.solve(rhs[:, :columns])
        expected = _dense_solution(symmetric, skew, rhs[:, :columns])
        np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-12)
        assert (solver.fallbacks, len(factored)) == (fallbacks, factors)
        assert (solver.iterations > before) == iterates


def test_a_single_column_that_the_iteration_was_too_slow_for_is_tried_again() -> None:
    symmetric, rhs = positive_definite(), right_hand_sides(N)
    solver = _factored(symmetric, antisymmetric(symmetric, 1e3))
    solver.solve(rhs)
    assert (solver.fallbacks, solver.iterations) == (1, 0)
    skew = antisymmetric(symmetric, 0.01)
    solver.factor(lower_triangle(symmetric).data, values_on(symmetric, skew))
    expected = _dense_solution(symmetric, skew, rhs)
    np.testing.assert_allclose(solver.solve(rhs), expected, rtol=1e-7, atol=1e-12)
    assert solver.fallbacks == 1 and solver.iterations > 0


@pytest.mark.parametrize("shape", SHAPES)
def test_an_indefinite_symmetric_part_is_left_to_superlu(shape: tuple[int, ...]) -> None:
    definite = positive_definite()
    skew, rhs = antisymmetric(definite, 0.01), right_hand_sides(*shape)
    solver = _factored(indefinite(), skew)
    expected = _dense_solution(indefinite(), skew, rhs)
    np.testing.assert_allclose(solver.solve(rhs), expected, rtol=1e-9)
    assert (solver.fallbacks, solver.iterations) == (1, 0)
    solver.factor(lower_triangle(definite).data, values_on(definite, skew))
    expected = _dense_solution(definite, skew, rhs)
    np.testing.assert_allclose(solver.solve(rhs), expected, rtol=1e-7, atol=1e-12)
    assert solver.fallbacks == 1


@pytest.mark.parametrize("accuracy", [1e-2, 1e-5, 1e-10])
def test_the_accuracy_is_that_of_the_true_residual(accuracy: float) -> None:
    symmetric = positive_definite()
    skew, rhs = antisymmetric(symmetric, 0.1), right_hand_sides(N)
    solver = _factored(symmetric, skew)
    residual = (symmetric + skew) @ solver.solve(rhs, accuracy) - rhs
    assert np.linalg.norm(residual) <= accuracy * np.linalg.norm(rhs)


def test_an_ill_conditioned_system_is_solved_as_well_as_rounding_allows() -> None:
    symmetric = soft(1e9)
    skew, rhs = antisymmetric(symmetric, 0.01), np.ones(N)
    solver = _factored(symmetric, skew)
    solution = solver.solve(rhs)
    residual = np.linalg.norm((symmetric + skew) @ solution - rhs) / np.linalg.norm(rhs)
    assert RESIDUAL < residual < LARGEST_RESIDUAL
    np.testing.assert_allclose(solution, _dense_solution(symmetric, skew, rhs), rtol=1e-6)
    assert solver.fallbacks == 0


@pytest.mark.parametrize("scale", [1e-200, 1e200])
def test_the_size_of_the_right_hand_side_does_not_matter(scale: float) -> None:
    symmetric = positive_definite()
    skew, rhs = antisymmetric(symmetric, 0.01), scale * right_hand_sides(N, 3)
    expected = _dense_solution(symmetric, skew, rhs)
    solution = _factored(symmetric, skew).solve(rhs)
    np.testing.assert_allclose(solution, expected, rtol=1e-7, atol=1e-12 * scale)


def test_a_singular_matrix_raises_and_leaves_nothing_to_solve_with() -> None:
    symmetric = chain(np.ones(N - 1))
    solver = UnsymmetricSolver(*pattern(symmetric))
    with pytest.raises(LinearSolverError, match="singular"):
        solver.factor(lower_triangle(symmetric).data, np.zeros(lower_triangle(symmetric).nnz))
    with pytest.raises(RuntimeError, match="factor first"):
        solver.solve(right_hand_sides(N))


@pytest.mark.parametrize("spoil", [np.nan, np.inf, 0.0, 1e200])
def test_garbage_from_the_cholesky_factor_is_caught_and_mended(
    monkeypatch: pytest.MonkeyPatch, spoil: float
) -> None:
    symmetric = positive_definite()
    skew, rhs = antisymmetric(symmetric, 0.01), right_hand_sides(N, 3)
    solver = _factored(symmetric, skew)
    monkeypatch.setattr(Cholesky, "solve", lambda _, b: np.full_like(b, spoil))
    expected = _dense_solution(symmetric, skew, rhs)
    np.testing.assert_allclose(solver.solve(rhs), expected, rtol=1e-9)
    assert solver.fallbacks == 1


def test_a_system_that_no_backend_solves_raises(monkeypatch: pytest.MonkeyPatch) -> None:
    class Spoiled:
        U = sp.eye_array(N)
        perm_c = np.arange(N)

        @staticmethod
        def solve(rhs: FloatArray) -> FloatArray:
            return np.ones_like(rhs)

    symmetric = positive_definite()
    solver = _factored(symmetric, antisymmetric(symmetric, 1e3))
    monkeypatch.setattr(superlu, "splu", lambda *_args, **_options: Spoiled())
    with pytest.raises(LinearSolverError, match="relative residual"):
        solver.solve(right_hand_sides(N))


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("part", [0, 1])
def test_a_value_that_is_not_finite_raises(bad: float, part: int) -> None:
    symmetric = positive_definite()
    skew = antisymmetric(symmetric, 0.1)
    solver = _factored(symmetric, skew)
    with pytest.raises(LinearSolverError, match="right-hand side .* not finite"):
        solver.solve(np.full(N, bad))
    parts = [lower_triangle(symmetric).data, values_on(symmetric, skew)]
    parts[part][3] = bad
    with pytest.raises(LinearSolverError, match="matrix has a value that is not finite"):
        solver.factor(*parts)
    with pytest.raises(RuntimeError, match="factor first"):
        solver.solve(right_hand_sides(N))


def test_rounding_on_the_diagonal_of_the_antisymmetric_part_is_dropped() -> None:
    symmetric = positive_definite()
    skew, rhs = antisymmetric(symmetric, 0.1), right_hand_sides(N)
    expected = _factored(symmetric, skew).solve(rhs)
    rounded = skew + 1e-14 * sp.diags_array(right_hand_sides(N))
    np.testing.assert_array_equal(_factored(symmetric, rounded).solve(rhs), expected)


def test_values_of_the_wrong_number_or_on_the_diagonal_raise() -> None:
    symmetric = positive_definite()
    solver, values = UnsymmetricSolver(*pattern(symmetric)), lower_triangle(symmetric).data
    with pytest.raises(ValueError, match="one for each entry"):
        solver.factor(values, values[:-1])
    with pytest.raises(ValueError, match="one for each entry"):
        solver.factor(values[:-1], values)
    with pytest.raises(ValueError, match="on the diagonal, expected zeros"):
        solver.factor(values, values)
    with pytest.raises(ValueError, match="right-hand side: found shape"):
        _factored(symmetric, antisymmetric(symmetric, 0.1)).solve(np.zeros(N + 1))
