"""Cholesky factors of a weighted sum of fixed symmetric matrices, dense if small."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, TypeAlias

import numpy as np
from scipy.linalg.lapack import dpotrf, dpotri, dpotrs
from scipy.sparse import csc_array

from driver.dic.patterns import lower_union, spread
from meshes.arrays import FloatArray, IntArray
from solver_adapters.cholesky import Cholesky

Matrix: TypeAlias = FloatArray | csc_array

DENSE = 400  # unknowns, up to which dense matrices are faster than sparse ones


class Factor(Protocol):
    """The factor of Σ a_k A_k, scaled to unit diagonal.

    Attributes:
        scale: D, by which the matrix becomes one of unit diagonal, D A D, shape (n,).
    """

    scale: FloatArray

    def set(self, weights: Sequence[float], ridge: float) -> bool:
        """Factor the sum and a ridge on its scaled diagonal; whether it is positive definite."""

    def solve(self, right: FloatArray) -> FloatArray:
        """Solution for right-hand sides of shape (n,) or (n, m)."""

    def solve_scaled(self, right: FloatArray) -> FloatArray:
        """Solution with the scaled matrix, shape (n,)."""


def make_factor(terms: Sequence[Matrix]) -> Factor:
    """Return the factor that suits the matrices A_k, all dense or all sparse."""
    dense = [term for term in terms if isinstance(term, np.ndarray)]
    return DenseFactor(dense) if len(dense) == len(terms) else SparseFactor(terms)


class DenseFactor:
    """By LAPACK: its arrays run down the columns, symmetric ones either way."""

    def __init__(self, terms: Sequence[FloatArray]) -> None:
        """Keep the matrices."""
        self._terms = terms

    def set(self, weights: Sequence[float], ridge: float) -> bool:
        """As in `Factor`."""
        total = self._terms[0] * weights[0]
        for weight, term in zip(weights[1:], self._terms[1:], strict=True):
            if weight:
                total += weight * term
        self.scale = _scale(total.diagonal())
        total *= self.scale[:, None]
        total *= self.scale
        total.flat[:: len(total) + 1] += ridge
        self._factor, info = dpotrf(total, lower=1, overwrite_a=1)
        return bool(info == 0)

    def solve(self, right: FloatArray) -> FloatArray:
        """As in `Factor`."""
        scale = self.scale if right.ndim == 1 else self.scale[:, None]
        return np.asarray(scale * dpotrs(self._factor, scale * right, lower=1)[0])

    def traces(self) -> list[float]:
        """Traces of the inverse times each term but the first."""
        inverse = dpotri(self._factor, lower=1)[0]  # its lower triangle, above it zeros
        inverse *= self.scale[:, None]
        inverse *= self.scale
        inverse.flat[:: len(inverse) + 1] *= 0.5
        return [2.0 * float(np.vdot(inverse.T, term)) for term in self._terms[1:]]

    def solve_scaled(self, right: FloatArray) -> FloatArray:
        """As in `Factor`."""
        return np.asarray(dpotrs(self._factor, right, lower=1)[0])


class SparseFactor:
    """By CHOLMOD, the pattern analysed once."""

    def __init__(self, terms: Sequence[Matrix]) -> None:
        """Bring the lower triangles onto one pattern and analyse it."""
        columns = [_columns(term) for term in terms]
        indptr, rows = columns[0][:2]
        for other in columns[1:] or columns:
            indptr, rows = lower_union(indptr, rows, *other[:2])
        self._values = [spread(indptr, rows, *term) for term in columns]
        self._rows, self._diagonal = rows, indptr[:-1]
        self._columns = np.repeat(np.arange(len(indptr) - 1), np.diff(indptr))
        self._cholesky = Cholesky(indptr, rows)

    def set(self, weights: Sequence[float], ridge: float) -> bool:
        """As in `Factor`."""
        total = self._cholesky.values
        total[:] = 0.0
        for weight, values in zip(weights, self._values, strict=True):
            if weight:
                total += weight * values
        self.scale = _scale(total[self._diagonal])
        total *= self.scale[self._rows]
        total *= self.scale[self._columns]
        total[self._diagonal] += ridge
        return self._cholesky.factor()

    def solve(self, right: FloatArray) -> FloatArray:
        """As in `Factor`."""
        scale = self.scale[:, None]
        columns = scale * right.reshape(len(scale), -1)
        return np.asarray((scale * self._cholesky.solve(columns)).reshape(right.shape))

    def solve_scaled(self, right: FloatArray) -> FloatArray:
        """As in `Factor`."""
        return self._cholesky.solve(right[:, None])[:, 0]


def _scale(diagonal: FloatArray) -> FloatArray:
    return np.asarray(1 / np.sqrt(np.where(diagonal > 0, diagonal, diagonal.max())))


def _columns(matrix: Matrix) -> tuple[IntArray, IntArray, FloatArray]:
    """indptr, indices (sorted) and data."""
    sparse = csc_array(matrix)
    sparse.sort_indices()
    return sparse.indptr.astype(np.int64), sparse.indices.astype(np.int64), sparse.data
