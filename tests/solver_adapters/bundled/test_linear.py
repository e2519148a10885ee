"""Every solution is checked: right, mended by the fallback, or an error."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from cvxopt import cholmod

from solver_adapters.bundled import linear
from solver_adapters.bundled.linear import LinearSolverError, SymmetricSolver
from solver_adapters.interface import FloatArray

N = 60


def _spd(seed: int = 0, n: int = N) -> Any:
    """A random sparse symmetric matrix, strictly diagonally dominant, thus positive definite."""
    random = sp.random_array((n, n), density=0.1, rng=np.random.default_rng(seed))
    symmetric = random + random.T
    return sp.csc_array(symmetric + sp.diags_array(abs(symmetric).sum(axis=0) + 1.0))


def _chain(stiffness: FloatArray) -> Any:
    """Springs in a row, none of them fixed: singular, its null vector the rigid motion."""
    diagonal = np.append(stiffness, 0.0) + np.append(0.0, stiffness)
    return sp.csc_array(sp.diags_array([-stiffness, diagonal, -stiffness], offsets=[-1, 0, 1]))


def _lower(full: Any) -> Any:
    lower = sp.csc_array(sp.tril(full))
    lower.sort_indices()
    return lower


def _solver(full: Any) -> SymmetricSolver:
    lower = _lower(full)
    return SymmetricSolver(lower.indptr.astype(np.int64), lower.indices.astype(np.int64))


def _factored(full: Any) -> SymmetricSolver:
    solver = _solver(full)
    solver.factor(_lower(full).data)
    return solver


def _rhs(*shape: int) -> FloatArray:
    return np.random.default_rng(7).normal(size=shape)


def test_a_positive_definite_system_has_the_dense_solution() -> None:
    full = _spd()
    solver = _factored(full)
    expected = np.linalg.solve(full.toarray(), _rhs(N))
    np.testing.assert_allclose(solver.solve(_rhs(N)), expected, rtol=1e-12)
    assert solver.fallbacks == 0


@pytest.mark.parametrize("order", ["C", "F"])
def test_many_right_hand_sides_have_the_dense_solutions(order: Any) -> None:
    full = _spd()
    rhs = np.array(_rhs(N, 24), order=order)
    rhs[:, 5] = 0.0
    solution = _factored(full).solve(rhs)
    np.testing.assert_allclose(solution, np.linalg.solve(full.toarray(), rhs), rtol=1e-12)
    assert not solution[:, 5].any()


def test_no_right_hand_side_has_no_solution() -> None:
    assert _factored(_spd()).solve(np.zeros((N, 0))).shape == (N, 0)


def test_the_right_hand_side_is_left_as_it_was() -> None:
    rhs = _rhs(N)
    _factored(_spd()).solve(rhs)
    np.testing.assert_array_equal(rhs, _rhs(N))


def test_new_values_on_the_same_pattern_give_the_new_solution() -> None:
    full = _spd()
    solver = _factored(full)
    scale = sp.diags_array(np.linspace(1.0, 3.0, N))
    other = scale @ full @ scale
    solver.factor(_lower(other).data)
    expected = np.linalg.solve(other.toarray(), _rhs(N))
    np.testing.assert_allclose(solver.solve(_rhs(N)), expected, rtol=1e-12)
    assert solver.fallbacks == 0


def test_values_changed_by_the_caller_after_the_factorisation_have_no_effect() -> None:
    full = _spd()
    values = _lower(full).data
    solver = _solver(full)
    solver.factor(values)
    values[:] = -1.0
    expected = np.linalg.solve(full.toarray(), _rhs(N))
    np.testing.assert_allclose(solver.solve(_rhs(N)), expected, rtol=1e-12)


def test_an_indefinite_system_is_solved_by_the_fallback_and_counted() -> None:
    full = _spd()
    indefinite = full - sp.diags_array(full.diagonal() * (np.arange(N) % 3 == 0) * 2.0)
    eigenvalues = np.linalg.eigvalsh(indefinite.toarray())
    assert eigenvalues[0] < 0 < eigenvalues[-1]
    solver = _factored(indefinite)
    for rhs in (_rhs(N), _rhs(N, 3)):
        expected = np.linalg.solve(indefinite.toarray(), rhs)
        np.testing.assert_allclose(solver.solve(rhs), expected, rtol=1e-10)
    assert solver.fallbacks == 1


def test_after_an_indefinite_matrix_the_cholesky_factor_serves_again() -> None:
    full = _spd()
    solver = _solver(full)
    solver.factor(-_lower(full).data)
    solver.factor(_lower(full).data)
    expected = np.linalg.solve(full.toarray(), _rhs(N))
    np.testing.assert_allclose(solver.solve(_rhs(N)), expected, rtol=1e-12)
    assert solver.fallbacks == 1


@pytest.mark.parametrize("seed", range(5))
def test_a_singular_matrix_raises_although_rounding_hides_it(seed: int) -> None:
    stiffness = np.random.default_rng(seed).uniform(0.1, 10.0, N)
    with pytest.raises(LinearSolverError, match="singular"):
        _factored(_chain(stiffness))


def test_a_matrix_of_zeros_raises() -> None:
    solver = _solver(_spd())
    with pytest.raises(LinearSolverError, match="singular"):
        solver.factor(np.zeros(_lower(_spd()).nnz))


def test_after_a_failed_factorisation_there_is_nothing_to_solve_with() -> None:
    full = _spd()
    solver = _factored(full)
    with pytest.raises(LinearSolverError):
        solver.factor(np.zeros(_lower(full).nnz))
    with pytest.raises(RuntimeError, match="factor first"):
        solver.solve(_rhs(N))


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_value_that_is_not_finite_raises(bad: float) -> None:
    full = _spd()
    values = _lower(full).data
    values[3] = bad
    with pytest.raises(LinearSolverError, match="not finite"):
        _solver(full).factor(values)
    with pytest.raises(LinearSolverError, match="not finite"):
        _factored(full).solve(np.full(N, bad))


def test_a_wrong_number_of_values_raises() -> None:
    full = _spd()
    with pytest.raises(ValueError, match="one for each entry"):
        _solver(full).factor(full.data)


@pytest.mark.parametrize("shape", [(N + 1,), (3, N), ()])
def test_a_right_hand_side_of_another_size_raises(shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="right-hand side: found shape"):
        _factored(_spd()).solve(np.zeros(shape))


def _noise(_factor: Any, x: Any) -> None:
    np.asarray(x)[:] = 1e200 * _rhs(*x.size)


def _not_a_number(_factor: Any, x: Any) -> None:
    np.asarray(x)[:] = np.nan


def _nothing(_factor: Any, x: Any) -> None:
    np.asarray(x)[:] = 0.0


@pytest.mark.parametrize("spoiled", [_noise, _not_a_number, _nothing])
def test_garbage_from_the_cholesky_factor_is_caught_and_mended(
    monkeypatch: pytest.MonkeyPatch, spoiled: Callable[[Any, Any], None]
) -> None:
    full = _spd()
    solver = _factored(full)
    monkeypatch.setattr(cholmod, "solve", spoiled)
    for rhs in (_rhs(N), _rhs(N, 3)):
        expected = np.linalg.solve(full.toarray(), rhs)
        np.testing.assert_allclose(solver.solve(rhs), expected, rtol=1e-10)
    assert solver.fallbacks == 1


def test_garbage_in_one_column_of_many_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    full = _spd()
    solver = _factored(full)
    original = cholmod.solve

    def spoiled(factor: Any, x: Any) -> None:
        original(factor, x)
        np.asarray(x)[0, 20] += 1.0

    monkeypatch.setattr(cholmod, "solve", spoiled)
    expected = np.linalg.solve(full.toarray(), _rhs(N, 24))
    np.testing.assert_allclose(solver.solve(_rhs(N, 24)), expected, rtol=1e-10)
    assert solver.fallbacks == 1


@pytest.mark.parametrize(("change", "fallbacks"), [(1e-5, 0), (3.0, 1)])
def test_a_factor_of_older_values_is_refined_if_near_and_replaced_if_far(
    monkeypatch: pytest.MonkeyPatch, change: float, fallbacks: int
) -> None:
    full = _spd()
    solver = _factored(full)
    monkeypatch.setattr(cholmod, "numeric", lambda *_: None)
    other = full + change * sp.diags_array(np.linspace(0.0, 1.0, N) * full.diagonal())
    solver.factor(_lower(other).data)
    expected = np.linalg.solve(other.toarray(), _rhs(N))
    np.testing.assert_allclose(solver.solve(_rhs(N)), expected, rtol=1e-9)
    assert solver.fallbacks == fallbacks


def test_a_system_that_no_backend_solves_raises(monkeypatch: pytest.MonkeyPatch) -> None:
    class Spoiled:
        U = sp.eye_array(N)

        @staticmethod
        def solve(rhs: FloatArray) -> FloatArray:
            return np.ones_like(rhs)

    solver = _factored(_spd())
    monkeypatch.setattr(cholmod, "solve", _nothing)
    monkeypatch.setattr(linear, "splu", lambda *_args, **_options: Spoiled())
    with pytest.raises(LinearSolverError, match="relative residual"):
        solver.solve(_rhs(N))
