"""Rows of numbers along many directions against NumPy; what lies beyond their width stays."""

from __future__ import annotations

import numpy as np
import pytest

from meshes.arrays import FloatArray
from solver_adapters.bundled.law import simd_rows
from solver_adapters.bundled.law.simd_rows import LANES
from tests.solver_adapters.bundled.from_python import FromPython

kernels = FromPython(simd_rows)

RNG = np.random.default_rng(3)
TARGET, SOURCE, ROWS = 2 * LANES, 20 * LANES, 40
WIDTHS = pytest.mark.parametrize("width", [1, 7, 26, LANES])


def block() -> FloatArray:
    return RNG.normal(size=ROWS * LANES)


def rows(b: FloatArray, offset: int, count: int, width: int) -> FloatArray:
    return b[offset : offset + LANES * count].reshape(count, LANES)[:, :width]


def only(b: FloatArray, before: FloatArray, count: int, width: int) -> FloatArray:
    """The rows at TARGET after a change, once nothing else has changed."""
    found, rest = rows(b, TARGET, count, width).copy(), b.copy()
    rows(rest, TARGET, count, width)[:] = rows(before, TARGET, count, width)
    np.testing.assert_array_equal(rest, before)
    return found


@WIDTHS
@pytest.mark.parametrize("count", [5, 8, 9])
def test_sums_over_rows_are_products_with_strided_coefficients(count: int, width: int) -> None:
    b, w = block(), RNG.normal(size=400)
    before, coefficients = b.copy(), w[3 : 3 + 7 * count : 7]
    if count == 9:
        kernels.sum9(b, TARGET, SOURCE, w, 3, 7, width)
        factor = 1.0
    else:
        factor = -0.4
        {5: kernels.sum5, 8: kernels.sum8}[count](b, TARGET, SOURCE, w, 3, 7, factor, width)
    expected = rows(before, TARGET, 1, width)[0] + factor * (
        coefficients @ rows(before, SOURCE, count, width)
    )
    np.testing.assert_allclose(only(b, before, 1, width)[0], expected, rtol=0, atol=1e-13)


@WIDTHS
@pytest.mark.parametrize("turned", [False, True])
def test_products_with_one_tensor_are_those_of_the_matrices(width: int, turned: bool) -> None:
    w = RNG.normal(size=30)
    a = w[4:13].reshape(3, 3)
    b = block()
    before, many = b.copy(), rows(b, SOURCE, 9, width).reshape(3, 3, width).copy()
    kernels.left(b, TARGET, w, 4, SOURCE, turned, width)
    expected = np.einsum("ik,jkm->ijm" if turned else "ik,kjm->ijm", a, many)
    found = only(b, before, 9, width).reshape(3, 3, width)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13)
    b = before.copy()
    kernels.right(b, TARGET, SOURCE, w, 4, turned, width)
    expected = np.einsum("ikm,jk->ijm" if turned else "ikm,kj->ijm", many, a)
    found = only(b, before, 9, width).reshape(3, 3, width)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13)


@WIDTHS
def test_rows_are_cleared_added_fetched_and_stored(width: int) -> None:
    b, first = block(), 3
    before = b.copy()
    kernels.clear(b, TARGET, 4, width)
    assert not only(b, before, 4, width).any()
    kernels.add(b, TARGET, SOURCE, -2.0, 4, width)
    np.testing.assert_array_equal(
        only(b, before, 4, width), -2.0 * rows(before, SOURCE, 4, width)
    )  # fmt: skip
    given = RNG.normal(size=(6, first + LANES + 1))
    kernels.fetch(b, TARGET, 4, given, first, width)
    np.testing.assert_array_equal(only(b, before, 4, width), given[:4, first : first + width])
    taken = given.copy()
    kernels.store(b, SOURCE, 4, taken, first, width)
    given[:4, first : first + width] = rows(before, SOURCE, 4, width)
    np.testing.assert_array_equal(taken, given)
