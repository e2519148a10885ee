"""Cholesky factors of one pattern by CHOLMOD, which comes in the wheel of cvxopt."""

from __future__ import annotations

import numpy as np

from meshes.arrays import FloatArray, IntArray
from solver_adapters.cholmod import cholmod, matrix, sparse, spmatrix


class Cholesky:
    """One symbolic analysis, many factorisations of a positive definite matrix.

    Attributes:
        values: entries of the lower triangle in the order of the pattern, shape (nnz,): write them,
            then `factor`. The factor stays that of the values it was made of.
    """

    def __init__(self, indptr: IntArray, indices: IntArray, order: IntArray | None = None) -> None:
        """Analyse the pattern of the lower triangle.

        Args:
            indptr: start of each column (CSC), shape (n + 1,).
            indices: row of each entry, increasing within a column and beginning with the
                diagonal, shape (nnz,).
            order: in which the unknowns may be eliminated, shape (n,): taken where its factor has
                fewer entries than that of minimum degree.
        """
        n = len(indptr) - 1
        # One buffer under both CHOLMOD's matrix and `values`, which are then copied only once.
        self._buffer = matrix(0.0, (len(indices), 1))
        self.values: FloatArray = np.asarray(self._buffer)[:, 0]
        columns = np.repeat(np.arange(n), np.diff(indptr))
        rows = matrix(indices.astype(np.int64))
        self._matrix = spmatrix(1.0, rows, matrix(columns), (n, n))
        own = () if order is None else (matrix(order),)
        self._factor = cholmod.symbolic(self._matrix, *own)

    def factor(self) -> bool:
        """Factor `values`; whether they are positive definite, and more than by rounding."""
        self._matrix.V = self._buffer
        try:
            cholmod.numeric(self._matrix, self._factor)
        except ArithmeticError:  # a pivot that is not positive
            return False
        return not singular(np.asarray(cholmod.diag(self._factor))[:, 0] ** 2)

    def solve(self, rhs: FloatArray) -> FloatArray:
        """Solve with the last factor, unchecked, shape (n, m).

        `cholmod.solve` takes one column at a time, `spsolve` four: half the time from four columns
        on, even though it wants (and gives) a sparse matrix.
        """
        solution = matrix(rhs)
        if rhs.shape[1] < 3:
            cholmod.solve(self._factor, solution)
        else:
            solution = matrix(cholmod.spsolve(self._factor, sparse(solution)))
        return np.ascontiguousarray(solution)


def singular(pivots: FloatArray) -> bool:
    """Whether a pivot is no more than rounding (a small residual alone cannot tell)."""
    return bool(pivots.min() <= pivots.size * np.finfo(np.float64).eps * pivots.max())
