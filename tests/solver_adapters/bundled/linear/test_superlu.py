"""SuperLU factors whatever is not singular, and finds its order of elimination once."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from meshes.arrays import FloatArray
from solver_adapters.bundled.linear import superlu
from solver_adapters.bundled.linear.residual_check import LinearSolverError
from solver_adapters.bundled.linear.split_matrix import TwoTriangles
from solver_adapters.bundled.linear.superlu import SuperLU
from tests.solver_adapters.bundled.matrices import (
    N,
    antisymmetric,
    chain,
    indefinite,
    lower_triangle,
    pattern,
    positive_definite,
    values_on,
)


def _matrix(full: Any, skew: FloatArray | float = 0.0) -> TwoTriangles:
    values = lower_triangle(full).data
    return TwoTriangles(*pattern(full), values + skew, values - skew)


def test_an_indefinite_matrix_is_solved_and_a_singular_one_refused() -> None:
    full, expected = indefinite(), np.random.default_rng(2).normal(size=(N, 2))
    found = SuperLU(_matrix(full)).factor()(full @ expected)
    np.testing.assert_allclose(found, expected, atol=1e-10)
    with pytest.raises(LinearSolverError, match=f"singular matrix of {N} unknowns"):
        SuperLU(_matrix(chain(np.ones(N - 1)))).factor()


def test_later_values_are_factored_in_an_order_that_is_found_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    orders: list[str] = []

    def watched(matrix: Any, permc_spec: str, **options: Any) -> Any:
        orders.append(permc_spec)
        return splu(matrix, permc_spec=permc_spec, **options)

    monkeypatch.setattr(superlu, "splu", watched)
    symmetric = positive_definite()
    skew = antisymmetric(symmetric, 0.5)
    matrix = _matrix(symmetric, values_on(symmetric, skew))
    solver, rhs = SuperLU(matrix), np.random.default_rng(3).normal(size=(N, 3))
    backsolves = [solver.factor()]
    wanted = [np.linalg.solve((symmetric + skew).toarray(), rhs)]
    for stronger in (2.0, 30.0):
        matrix.lower[:] *= stronger
        matrix.upper[:] *= stronger
        matrix.lower[1] += 0.4 * stronger  # one side of the diagonal alone
        full = matrix.full().toarray()
        backsolves.append(solver.factor())
        wanted.append(np.linalg.solve(full, rhs))
    for backsolve, expected in zip(backsolves, wanted, strict=True):
        np.testing.assert_allclose(backsolve(rhs), expected, rtol=1e-8, atol=1e-12)
        np.testing.assert_allclose(backsolve(rhs[:, 0]), expected[:, 0], rtol=1e-8, atol=1e-12)
    assert orders == ["MMD_AT_PLUS_A", *3 * ["NATURAL"]]


def test_a_factor_has_the_same_digits_whatever_was_factored_before() -> None:
    """One whose first values hold zeros, which leave the pattern as it is."""
    symmetric = positive_definite()
    skew = values_on(symmetric, antisymmetric(symmetric, 0.5))
    rhs = np.random.default_rng(3).normal(size=(N, 3))
    fresh = SuperLU(_matrix(symmetric, skew)).factor()(rhs)
    matrix = _matrix(symmetric, skew)
    lower, upper = matrix.lower.copy(), matrix.upper.copy()
    off = np.flatnonzero(np.not_equal(*matrix.positions()))
    matrix.lower[off[::2]] = matrix.upper[off[::2]] = 0.0
    solver = SuperLU(matrix)
    solver.factor()
    matrix.lower[:], matrix.upper[:] = lower, upper
    np.testing.assert_array_equal(solver.factor()(rhs), fresh)


def test_the_factor_has_no_more_entries_than_by_minimum_degree_of_its_own(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of a grid of 20 × 20, whose own order would fill three times as much."""
    line = sp.diags_array([-np.ones(19), 4.0 * np.ones(20), -np.ones(19)], offsets=[-1, 0, 1])
    grid = sp.kron(sp.eye_array(20), line) - sp.kron(
        sp.diags_array([np.ones(19), np.ones(19)], offsets=[-1, 1]), sp.eye_array(20)
    )
    filled: list[int] = []

    def watched(matrix: Any, **options: Any) -> Any:
        factors = splu(matrix, **options)
        filled.append(factors.L.nnz + factors.U.nnz)
        return factors

    monkeypatch.setattr(superlu, "splu", watched)
    SuperLU(_matrix(sp.csc_array(grid))).factor()
    by_degree, found = filled
    plain = splu(sp.csc_array(grid), permc_spec="NATURAL")
    assert found <= by_degree < (plain.L.nnz + plain.U.nnz) / 2


def test_a_singular_matrix_after_a_regular_one_is_refused_and_the_next_one_solved() -> None:
    full = positive_definite()
    matrix = _matrix(full)
    solver, values = SuperLU(matrix), matrix.lower.copy()
    solver.factor()
    matrix.lower[:] = matrix.upper[:] = 0.0
    with pytest.raises(LinearSolverError, match=f"singular matrix of {N} unknowns"):
        solver.factor()
    matrix.lower[:] = matrix.upper[:] = values
    expected = 1.0 + np.arange(N)
    np.testing.assert_allclose(solver.factor()(full @ expected), expected, rtol=1e-8)
