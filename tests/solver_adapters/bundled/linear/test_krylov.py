"""Iterations converge at the rates that theory gives them, and give up where it does not pay."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp

from meshes.arrays import FloatArray
from solver_adapters.bundled.linear.krylov import PATIENCE, conjugate_gradients, skew_iteration
from solver_adapters.bundled.linear.split_matrix import TwoTriangles
from tests.solver_adapters.bundled.matrices import (
    N,
    antisymmetric,
    indefinite,
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


def _inverse(full: Any) -> Callable[[FloatArray], FloatArray]:
    dense = full.toarray()
    return lambda rhs: np.linalg.solve(dense, rhs)


def _near(full: Any, spread: float) -> Any:
    """D A D: eigenvalues of (D A D)⁻¹ A are spread over the squares of 1/D."""
    scale = sp.diags_array(np.linspace(1.0, spread, N))
    return sp.csc_array(scale @ full @ scale)


def test_the_right_factor_needs_one_iteration() -> None:
    full, rhs = positive_definite(), right_hand_sides(N, 1)
    found = conjugate_gradients(_symmetric(full), _inverse(full), rhs, 1e-12, 12)
    assert found is not None
    assert found[1] == 1
    np.testing.assert_allclose(found[0], _inverse(full)(rhs), rtol=1e-11)


# With condition number κ of M⁻¹A, the error in the energy falls as 2((√κ − 1)/(√κ + 1))^k
# (Saad, Iterative Methods for Sparse Linear Systems, 2nd ed., 2003, equation 6.128).
def test_conjugate_gradients_are_as_fast_as_their_bound() -> None:
    full, rhs = positive_definite(), right_hand_sides(N, 1)
    near = _near(full, 1.3)
    eigenvalues = np.linalg.eigvals(np.linalg.solve(near.toarray(), full.toarray())).real
    root = np.sqrt(eigenvalues.max() / eigenvalues.min())
    condition = np.linalg.cond(full.toarray())
    for accuracy in (1e-2, 1e-5, 1e-9):
        found = conjugate_gradients(_symmetric(full), _inverse(near), rhs, accuracy, N)
        assert found is not None
        assert np.linalg.norm(full @ found[0] - rhs) <= accuracy * np.linalg.norm(rhs)
        bound = np.log(accuracy / 2 / np.sqrt(condition)) / np.log((root - 1) / (root + 1))
        assert found[1] <= np.ceil(bound)


def test_a_tight_accuracy_gives_the_dense_solution() -> None:
    full, rhs = positive_definite(), right_hand_sides(N, 1)
    found = conjugate_gradients(_symmetric(full), _inverse(_near(full, 1.3)), rhs, 1e-10, N)
    assert found is not None
    np.testing.assert_allclose(found[0], _inverse(full)(rhs), rtol=1e-8)


@pytest.mark.parametrize("scale", [0.0, 1e-200, 1e200])
def test_the_size_of_the_right_hand_side_does_not_matter(scale: float) -> None:
    full, rhs = positive_definite(), right_hand_sides(N, 1)
    near = _near(full, 1.3)
    found = conjugate_gradients(_symmetric(full), _inverse(near), scale * rhs, 1e-10, N)
    assert found is not None
    np.testing.assert_allclose(found[0], scale * _inverse(full)(rhs), rtol=1e-8)


def test_an_indefinite_matrix_is_given_up() -> None:
    rhs, near = right_hand_sides(N, 1), _inverse(positive_definite())
    assert conjugate_gradients(_symmetric(indefinite()), near, rhs, 1e-10, N) is None


@pytest.mark.parametrize("value", [np.nan, np.inf, 0.0, -1.0, 1e300])
def test_a_useless_preconditioner_is_given_up(value: float) -> None:
    matrix, rhs = _symmetric(positive_definite()), right_hand_sides(N, 1)

    def useless(residual: FloatArray) -> FloatArray:
        return value * residual

    with np.errstate(over="ignore"):
        assert conjugate_gradients(matrix, useless, rhs, 1e-10, 12) is None


# Condition 1e12: the residual of the recurrence goes on falling where that of x no longer can.
def test_a_recurrence_that_has_left_the_truth_is_given_up() -> None:
    full, rhs = soft(1e12), 1.0 + 0.1 * right_hand_sides(N, 1)
    near, last = _inverse(_near(full, 1.0001)), []

    def watched(residual: FloatArray) -> FloatArray:
        last.append(np.linalg.norm(residual))
        return near(residual)

    assert conjugate_gradients(_symmetric(full), watched, rhs, 1e-10, 200) is None
    assert len(last) < 200


def test_conjugate_gradients_behind_the_pace_stop_early() -> None:
    matrix, rhs, calls = _symmetric(positive_definite()), right_hand_sides(N, 1), []
    far = _inverse(_near(positive_definite(), 100.0))

    def counted(residual: FloatArray) -> FloatArray:
        calls.append(1)
        return far(residual)

    assert conjugate_gradients(matrix, counted, rhs, 1e-10, 12) is None
    assert len(calls) == PATIENCE


def _unsymmetric(symmetric: Any, skew: Any) -> TwoTriangles:
    s, n = values_on(symmetric, symmetric), values_on(symmetric, skew)
    return TwoTriangles(*pattern(symmetric), s + n, s - n)


# The bound is that of the Chebyshev polynomials on the segment of the eigenvalues 1 ± iΛ
# (Widlund 1978); it holds in the energy of S, hence the room for the condition number of S.
@pytest.mark.parametrize("size", [1e-3, 1e-2, 0.1, 0.5, 2.0])
@pytest.mark.parametrize("columns", [1, 6])
def test_the_skew_iteration_is_as_fast_as_its_bound(size: float, columns: int) -> None:
    symmetric = positive_definite()
    skew = antisymmetric(symmetric, size)
    rhs = right_hand_sides(N, columns)
    rhs[:, 0] *= 1e8
    found = skew_iteration(_unsymmetric(symmetric, skew), _inverse(symmetric), rhs, 1e-10, 500)
    assert found is not None
    np.testing.assert_allclose(found[0], _inverse(symmetric + skew)(rhs), rtol=1e-6, atol=1e-9)
    room = 2 * np.sqrt(np.linalg.cond(symmetric.toarray())) * np.hypot(1.0, size)
    bound = np.log(1e-10 / room) / np.log(size / (1 + np.hypot(1.0, size)))
    assert found[1] <= np.ceil(bound) + 1


def test_a_column_of_zeros_stays_zero() -> None:
    symmetric = positive_definite()
    skew = antisymmetric(symmetric, 0.3)
    rhs = right_hand_sides(N, 3)
    rhs[:, 1] = 0.0
    found = skew_iteration(_unsymmetric(symmetric, skew), _inverse(symmetric), rhs, 1e-10, 50)
    assert found is not None
    assert not found[0][:, 1].any()


def test_a_skew_iteration_behind_the_pace_stops_early() -> None:
    symmetric, calls = positive_definite(), []
    solve = _inverse(symmetric)

    def counted(rhs: FloatArray) -> FloatArray:
        calls.append(1)
        return solve(rhs)

    matrix = _unsymmetric(symmetric, antisymmetric(symmetric, 30.0))
    assert skew_iteration(matrix, counted, right_hand_sides(N, 1), 1e-10, 30) is None
    assert len(calls) == PATIENCE + 1


@pytest.mark.parametrize("value", [np.nan, np.inf, 0.0, -1.0, 1e300])
def test_a_useless_factor_of_the_symmetric_part_is_given_up(value: float) -> None:
    symmetric = positive_definite()
    matrix = _unsymmetric(symmetric, antisymmetric(symmetric, 0.3))

    def useless(rhs: FloatArray) -> FloatArray:
        with np.errstate(over="ignore", invalid="ignore"):
            return value * rhs

    assert skew_iteration(matrix, useless, right_hand_sides(N, 2), 1e-10, 12) is None
