"""Products from two triangles are those of the whole; a solution is accepted for good reasons."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from meshes.arrays import FloatArray
from solver_adapters.bundled.linear.split_matrix import (
    LARGEST_RESIDUAL,
    RESIDUAL,
    TwoTriangles,
    column_norms,
)
from tests.solver_adapters.bundled.matrices import (
    N,
    antisymmetric,
    lower_triangle,
    pattern,
    positive_definite,
    right_hand_sides,
    soft,
    values_on,
)


def _symmetric(full: Any) -> TwoTriangles:
    values = lower_triangle(full).data
    return TwoTriangles(*pattern(full), values, values)


@pytest.mark.parametrize("size", [0.0, 1.0])
@pytest.mark.parametrize("shape", [(N,), (N, 3)])
def test_products_are_those_of_the_whole_matrix(size: float, shape: tuple[int, ...]) -> None:
    symmetric = positive_definite()
    skew = antisymmetric(symmetric, size)
    full = (symmetric + skew).toarray()
    s, n = values_on(symmetric, symmetric), values_on(symmetric, skew)
    matrix = TwoTriangles(*pattern(symmetric), s + n, s - n)
    x = right_hand_sides(*shape)
    np.testing.assert_allclose(matrix.full().toarray(), full, rtol=1e-15)
    np.testing.assert_allclose(matrix.product(x), full @ x, rtol=1e-12)
    np.testing.assert_allclose(matrix.magnitude(x), abs(full) @ abs(x), rtol=1e-12)


def test_values_changed_in_place_change_the_products() -> None:
    full = positive_definite()
    matrix = _symmetric(full)
    matrix.lower *= 2.0
    x = right_hand_sides(N, 2)
    np.testing.assert_allclose(matrix.product(x), 2.0 * full @ x, rtol=1e-12)
    np.testing.assert_allclose(matrix.full().toarray(), 2.0 * full.toarray())


@pytest.mark.parametrize("scale", [1e-200, 1.0, 1e200])
def test_norms_neither_overflow_nor_underflow(scale: float) -> None:
    x = np.array([[3.0, 0.0], [4.0, 0.0]])
    np.testing.assert_allclose(column_norms(scale * x), [5.0 * scale, 0.0], rtol=1e-15)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_solution_that_is_not_finite_is_refused(bad: float) -> None:
    matrix = _symmetric(positive_definite())
    rhs = right_hand_sides(N, 2)
    solution = np.linalg.solve(matrix.full().toarray(), rhs)
    solution[3, 1] = bad
    with np.errstate(invalid="ignore"):
        accepted = matrix.accepted(rhs, solution, rhs - matrix.product(solution), RESIDUAL)
    assert accepted.tolist() == [True, False]


def _accepted(matrix: TwoTriangles, rhs: FloatArray, solution: FloatArray) -> bool:
    residual = rhs - matrix.product(solution)
    return bool(matrix.accepted(rhs, solution, residual, RESIDUAL)[0])


# The springs carry 1e8 times the force of the ground: their rounding is more than 1e-10 of it.
def test_a_residual_that_is_all_rounding_is_accepted_and_a_larger_one_is_not() -> None:
    matrix = _symmetric(soft(1e8))
    rhs = 1.0 + 0.1 * right_hand_sides(N, 1)
    solution = np.linalg.solve(matrix.full().toarray(), rhs)
    residual = column_norms(rhs - matrix.product(solution)) / column_norms(rhs)
    assert 10 * RESIDUAL < residual < LARGEST_RESIDUAL
    assert _accepted(matrix, rhs, solution)
    # Some units of the last place too many: still below LARGEST_RESIDUAL, but not rounding.
    worse = solution * (1 + 2e-15 * np.sign(right_hand_sides(N, 1)))
    residual = column_norms(rhs - matrix.product(worse)) / column_norms(rhs)
    assert residual < LARGEST_RESIDUAL
    assert not _accepted(matrix, rhs, worse)


def test_where_rounding_leaves_too_much_nothing_is_accepted() -> None:
    matrix = _symmetric(soft(1e12))
    rhs = 1.0 + 0.1 * right_hand_sides(N, 1)
    solution = np.linalg.solve(matrix.full().toarray(), rhs)
    residual = column_norms(rhs - matrix.product(solution)) / column_norms(rhs)
    assert residual > LARGEST_RESIDUAL
    assert not _accepted(matrix, rhs, solution)
