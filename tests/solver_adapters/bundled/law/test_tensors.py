"""Tensors inside the workspace of a point against NumPy's sums over indices."""

from __future__ import annotations

import numpy as np
import pytest

from meshes.arrays import FloatArray
from solver_adapters.bundled.law import tensors
from solver_adapters.bundled.law.law import SLIP_MODES, local_parameters
from solver_adapters.material import Material
from tests.solver_adapters.bundled.elasticity import stiffness
from tests.solver_adapters.bundled.from_python import FromPython

kernels = FromPython(tensors)

WIDTHS = (1, 8, 9)
A, B, RESULT = 4, 100, 200
"""Places in the workspace; what lies between them is NaN and has to stay so."""


def _stored(tensor: FloatArray) -> FloatArray:
    """Tensors (width, ...) component first."""
    return np.moveaxis(tensor, 0, -1).ravel()


def _workspace(a: FloatArray, b: FloatArray) -> FloatArray:
    w = np.full(300, np.nan)
    w[A : A + a.size] = _stored(a)
    w[B : B + b.size] = _stored(b)
    return w


def _result(w: FloatArray, shape: tuple[int, ...], width: int) -> FloatArray:
    """What stands at RESULT (width, *shape); nothing else was written."""
    size = int(np.prod(shape)) * width
    assert np.isnan(w[RESULT + size :]).all() and np.isnan(w[B + 81 : RESULT]).all()
    return np.moveaxis(w[RESULT : RESULT + size].reshape(*shape, width), -1, 0)


def _random(*shape: int) -> FloatArray:
    return np.random.default_rng(sum(shape)).normal(size=shape)


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("turn_a", [False, True])
@pytest.mark.parametrize("turn_b", [False, True])
def test_products_from_either_side_are_those_of_the_matrices(
    width: int, turn_a: bool, turn_b: bool
) -> None:
    a, b = _random(1, 3, 3), _random(width, 3, 3)
    one = a[0].T if turn_a else a[0]
    many = b.transpose(0, 2, 1) if turn_b else b
    w = _workspace(a, b)
    kernels.left(w, RESULT, A, turn_a, B, turn_b, width)
    np.testing.assert_allclose(_result(w, (3, 3), width), one @ many, atol=1e-14)
    kernels.right(w, RESULT, B, turn_b, A, turn_a, width)
    np.testing.assert_allclose(_result(w, (3, 3), width), many @ one, atol=1e-14)


@pytest.mark.parametrize("width", WIDTHS)
def test_a_multiple_is_added_in_place(width: int) -> None:
    a, b = _random(width, 3, 3), _random(width, 3, 3) + 1.0
    w = _workspace(a, b)
    kernels.add(w, A, B, -0.7, width)
    np.testing.assert_allclose(w[A : A + a.size], _stored(a - 0.7 * b), atol=1e-14)
    np.testing.assert_array_equal(w[B : B + b.size], _stored(b))


@pytest.mark.parametrize("width", WIDTHS)
def test_modes_are_components_along_the_orthonormal_tensors_of_the_law(width: int) -> None:
    """The trace is lost on the way there, nothing on the way back."""
    a, b = _random(width, 3, 3), _random(width, 8)
    w = _workspace(a, b)
    kernels.to_modes(w, RESULT, A, width)
    expected = np.einsum("kij,mij->mk", SLIP_MODES, a)
    np.testing.assert_allclose(_result(w, (8,), width), expected, atol=1e-14)
    kernels.to_tensors(w, RESULT, B, width)
    expected = np.einsum("kij,mk->mij", SLIP_MODES, b)
    np.testing.assert_allclose(_result(w, (3, 3), width), expected, atol=1e-14)


@pytest.mark.parametrize("width", WIDTHS)
def test_cubic_stresses_are_those_of_the_tensor_of_fourth_order(width: int) -> None:
    material = Material()
    strain = _random(width, 3, 3)
    w = _workspace(strain, strain)
    kernels.cubic(w, RESULT, A, local_parameters(material, 1)[0], width)
    expected = np.einsum("ijkl,mkl->mij", stiffness(material, np.eye(3)), strain)
    found = _result(w, (3, 3), width)
    np.testing.assert_allclose(found, expected, atol=1e-14 * abs(expected).max())


@pytest.mark.parametrize("width", WIDTHS)
def test_a_matrix_over_the_modes_acts_on_each_direction(width: int) -> None:
    matrix, modes = _random(8, 8), _random(width, 8)
    w = _workspace(matrix.T, modes)
    kernels.over_modes(w, RESULT, A, B, width)
    np.testing.assert_allclose(_result(w, (8,), width), modes @ matrix.T, atol=1e-13)


def test_determinant_and_cofactors_are_those_of_linear_algebra() -> None:
    """d det(a) = cof(a) : da, and cof(a) = det(a) a⁻ᵀ (Jacobi's formula)."""
    a = _random(1, 3, 3)
    w = _workspace(a, a)
    determinant = np.linalg.det(a[0])
    np.testing.assert_allclose(kernels.determinant_of(w, A), determinant, rtol=1e-13)
    kernels.cofactor(w, RESULT, A)
    expected = determinant * np.linalg.inv(a[0]).T
    np.testing.assert_allclose(w[RESULT : RESULT + 9].reshape(3, 3), expected, rtol=1e-13)
