"""Sparse matrices for the tests of the linear solvers, and their patterns."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp

from meshes.arrays import FloatArray, IntArray

N = 60


def positive_definite(seed: int = 0, n: int = N) -> Any:
    """A random sparse symmetric matrix, strictly diagonally dominant, thus positive definite."""
    random = sp.random_array((n, n), density=0.1, rng=np.random.default_rng(seed))
    symmetric = random + random.T
    return sp.csc_array(symmetric + sp.diags_array(abs(symmetric).sum(axis=0) + 1.0))


def indefinite() -> Any:
    """The same with the sign of every third diagonal entry turned."""
    full = positive_definite()
    return full - sp.diags_array(full.diagonal() * (np.arange(N) % 3 == 0) * 2.0)


def chain(stiffness: FloatArray) -> Any:
    """Springs in a row, none of them fixed: singular, its null vector the rigid motion."""
    diagonal = np.append(stiffness, 0.0) + np.append(0.0, stiffness)
    return sp.csc_array(sp.diags_array([-stiffness, diagonal, -stiffness], offsets=[-1, 0, 1]))


def soft(condition: float) -> Any:
    """Stiff springs in a row on soft ground: positive definite, of about this condition number."""
    return chain(np.full(N - 1, 0.25 * condition)) + sp.eye_array(N).tocsc()


def antisymmetric(full: Any, size: float, seed: int = 1) -> Any:
    """A random antisymmetric matrix on the pattern of `full`, with spectral radius(full⁻¹ N)
    equal to `size`."""
    pattern = lower_triangle(full)
    values = np.random.default_rng(seed).normal(size=pattern.nnz)
    below = sp.csc_array(sp.tril(sp.csc_array((values, pattern.indices, pattern.indptr)), k=-1))
    skew = below - below.T
    radius = abs(np.linalg.eigvals(np.linalg.solve(full.toarray(), skew.toarray()))).max()
    return sp.csc_array(skew * (size / radius))


def lower_triangle(full: Any) -> Any:
    """Lower triangle (CSC, sorted), diagonal included."""
    lower = sp.csc_array(sp.tril(full))
    lower.sort_indices()
    return lower


def pattern(full: Any) -> tuple[IntArray, IntArray]:
    """Column starts and rows of the lower triangle."""
    lower = lower_triangle(full)
    return lower.indptr.astype(np.int64), lower.indices.astype(np.int64)


def values_on(full: Any, matrix: Any) -> FloatArray:
    """Values of the lower triangle of a matrix on the pattern of `full`, zeros included."""
    lower = lower_triangle(full)
    columns = np.repeat(np.arange(lower.shape[0]), np.diff(lower.indptr))
    return np.asarray(matrix.toarray()[lower.indices, columns])


def right_hand_sides(*shape: int) -> FloatArray:
    """Random right-hand sides."""
    return np.random.default_rng(7).normal(size=shape)
