"""The checks that the sparse solvers share; what becomes of them is in the tests of the solvers."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from meshes.arrays import FloatArray
from solver_adapters.bundled.linear.residual_check import (
    checked_columns,
    copy_values,
    refined,
)
from solver_adapters.bundled.linear.split_matrix import RESIDUAL, TwoTriangles
from tests.solver_adapters.bundled.matrices import (
    N,
    lower_triangle,
    pattern,
    positive_definite,
)


def _matrix(full: Any) -> TwoTriangles:
    values = lower_triangle(full).data
    return TwoTriangles(*pattern(full), values, values)


def test_values_are_copied_to_where_they_are_used() -> None:
    values, target = np.arange(5.0), np.zeros(5)
    copy_values(values, target)
    values[0] = 7.0
    np.testing.assert_array_equal(target, np.arange(5.0))


def test_a_vector_and_its_column_are_the_same_right_hand_side() -> None:
    vector = np.arange(4.0)
    np.testing.assert_array_equal(checked_columns(vector, 4), vector[:, None])
    many = np.ones((4, 3))
    assert checked_columns(many, 4) is many


def test_a_rough_solver_is_refined_twice_and_no_more() -> None:
    """One that is wrong by a share e leaves e, e², e³ of the right-hand side."""
    full = positive_definite()
    rhs = np.random.default_rng(2).normal(size=(N, 1))
    inverse = np.linalg.inv(full.toarray())
    for share, accurate in ((1e-4, True), (1e-2, False)):
        calls: list[FloatArray] = []

        def rough(b: FloatArray, share: float = share, calls: list[FloatArray] = calls) -> Any:
            calls.append(b)
            return (1.0 + share) * (inverse @ b)

        solution, error = refined(_matrix(full), rhs, rough, RESIDUAL)
        left = np.linalg.norm(rhs - full @ solution) / np.linalg.norm(rhs)
        assert len(calls) == 3
        assert left == pytest.approx(share**3, rel=1e-2, abs=1e-14)
        assert (error is None) == accurate
