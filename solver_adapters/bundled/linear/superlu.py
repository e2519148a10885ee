"""SuperLU factors of sparse matrices of one pattern, whose order of elimination is found once."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from meshes.arrays import FloatArray, IntArray
from solver_adapters.bundled.linear.residual_check import LinearSolverError
from solver_adapters.bundled.linear.split_matrix import Backsolve, TwoTriangles
from solver_adapters.cholesky import singular


class SuperLU:
    """Factors of a matrix whose values change in place.

    In SuperLU's symmetric mode pivots stay near the diagonal. The order is that of minimum degree
    of the pattern, whatever the values, so that a factor does not hang on those before it.
    """

    def __init__(self, matrix: TwoTriangles) -> None:
        self._matrix = matrix
        self._ordered: _Layout | None = None

    def factor(self) -> Backsolve:
        """Factor the matrix with its values of now; what it returns solves with these.

        Raises:
            LinearSolverError: the matrix is singular.
        """
        if self._ordered is None:
            self._ordered = _Layout(self._matrix, _minimum_degree(self._matrix))
        order, message = self._ordered.order, f"singular matrix of {self._matrix.n} unknowns"
        try:
            factors = _factors(self._ordered.matrix(), "NATURAL")
        except RuntimeError as error:
            raise LinearSolverError(message) from error
        if singular(np.abs(factors.U.diagonal())):
            raise LinearSolverError(message)

        def backsolve(rhs: FloatArray) -> FloatArray:
            solution = np.empty_like(rhs)
            solution[order] = factors.solve(rhs[order])
            return solution

        return backsolve


class _Layout:
    """The whole matrix with its unknowns in another order."""

    def __init__(self, matrix: TwoTriangles, order: IntArray) -> None:
        self.order = order
        self._values = matrix
        rows, columns = matrix.positions()
        rank = np.argsort(order)
        off = np.flatnonzero(rows != columns)
        row = rank[np.concatenate((rows, columns[off]))]
        column = rank[np.concatenate((columns, rows[off]))]
        source = np.concatenate((np.arange(rows.size), rows.size + off))
        by_column = np.lexsort((row, column))
        counts = np.bincount(column, minlength=matrix.n)
        self._indptr = np.concatenate(([0], np.cumsum(counts))).astype(np.int32)
        self._indices, self._source = row[by_column].astype(np.int32), source[by_column]

    def matrix(self) -> sp.csc_array:
        """Return the matrix with its values of now, those that are null included."""
        m = self._values
        values = np.concatenate((m.lower, m.upper))[self._source]
        return sp.csc_array((values, self._indices, self._indptr), shape=(m.n, m.n))


def _minimum_degree(matrix: TwoTriangles) -> IntArray:
    """Return the order in which SuperLU eliminates the unknowns of a matrix of this pattern."""
    rows, columns = matrix.positions()
    # Any values that can be factored.
    values = np.where(rows == columns, 2.0 * rows.size, 1.0)
    pattern = TwoTriangles(*matrix.pattern, values, values)
    found = _factors(_Layout(pattern, np.arange(matrix.n)).matrix(), "MMD_AT_PLUS_A")
    return np.argsort(found.perm_c)


def _factors(matrix: sp.csc_array, order: str) -> Any:
    return splu(matrix, permc_spec=order, diag_pivot_thresh=0.01, options={"SymmetricMode": True})
