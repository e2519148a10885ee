"""Factors of CHOLMOD solve blocks of any width, and say where there is no factor."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from solver_adapters.cholesky import Cholesky
from tests.solver_adapters.bundled.matrices import (
    N,
    chain,
    indefinite,
    lower_triangle,
    pattern,
    positive_definite,
    right_hand_sides,
)


def _cholesky(full: Any) -> Cholesky:
    cholesky = Cholesky(*pattern(full))
    cholesky.values[:] = lower_triangle(full).data
    return cholesky


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("columns", [0, 1, 2, 3, 4, 5, 24])
def test_any_number_of_columns_is_solved_and_left_as_it_was(columns: int, order: Any) -> None:
    full = positive_definite()
    cholesky = _cholesky(full)
    assert cholesky.factor()
    rhs = np.array(right_hand_sides(N, columns), order=order)
    expected = np.linalg.solve(full.toarray(), rhs)
    np.testing.assert_allclose(cholesky.solve(rhs), expected, rtol=1e-12)
    np.testing.assert_array_equal(rhs, right_hand_sides(N, columns))


# A sparse solution leaves zeros out; here most of it is zero.
def test_zeros_of_a_block_of_solutions_are_where_they_belong() -> None:
    full = positive_definite() * np.equal.outer(np.arange(N) // 20, np.arange(N) // 20)
    cholesky = _cholesky(positive_definite())
    cholesky.values[:] = lower_triangle(positive_definite()).data
    lower = lower_triangle(positive_definite())
    columns = np.repeat(np.arange(N), np.diff(lower.indptr))
    cholesky.values[lower.indices // 20 != columns // 20] = 0.0
    assert cholesky.factor()
    rhs = np.zeros((N, 6))
    rhs[20:40, 1], rhs[2, 2], rhs[59, 5] = 1.0, -1.0, 3.0
    expected = np.linalg.solve(full.toarray(), rhs)
    solution = cholesky.solve(rhs)
    np.testing.assert_allclose(solution, expected, rtol=1e-12, atol=1e-18)
    assert not solution[:, [0, 3, 4]].any()
    assert not solution[:20, 1].any()


@pytest.mark.parametrize("full", [indefinite(), chain(np.arange(1.0, N)), chain(np.zeros(N - 1))])
def test_what_is_not_positive_definite_beyond_rounding_has_no_factor(full: Any) -> None:
    assert not _cholesky(full).factor()


def test_a_factor_stays_when_the_values_change() -> None:
    full = positive_definite()
    cholesky = _cholesky(full)
    assert cholesky.factor()
    cholesky.values[:] *= 5.0
    expected = np.linalg.solve(full.toarray(), right_hand_sides(N, 1))
    np.testing.assert_allclose(cholesky.solve(right_hand_sides(N, 1)), expected, rtol=1e-12)
