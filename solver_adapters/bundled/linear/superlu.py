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

    In SuperLU's symmetric mode pivots stay near the diagonal.
    """

    def __init__(self, matrix: TwoTriangles) -> None:
        self._matrix = matrix
        # The order of minimum degree, and the pattern in it, once there has been a factor.
        self._order: IntArray | None = None
        self._indptr = self._indices = self._source = np.empty(0, dtype=np.int64)

    def factor(self) -> Backsolve:
        """Factor the matrix with its values of now; what it returns solves with these.

        Raises:
            LinearSolverError: the matrix is singular.
        """
        if self._order is None:
            # The whole in the order of its unknowns, which SuperLU changes for its own.
            factors = self._factors(self._matrix.full(), "MMD_AT_PLUS_A")
            self._analyse(np.argsort(factors.perm_c))
            first: Backsolve = factors.solve
            return first
        n, order = self._matrix.n, self._order
        values = np.concatenate((self._matrix.lower, self._matrix.upper))[self._source]
        ordered = sp.csc_array((values, self._indices, self._indptr), shape=(n, n))
        factors = self._factors(ordered, "NATURAL")

        def backsolve(rhs: FloatArray) -> FloatArray:
            solution = np.empty_like(rhs)
            solution[order] = factors.solve(rhs[order])
            return solution

        return backsolve

    def _factors(self, matrix: sp.csc_array, order: str) -> Any:
        message = f"singular matrix of {self._matrix.n} unknowns"
        try:
            factors = splu(
                matrix, permc_spec=order, diag_pivot_thresh=0.01, options={"SymmetricMode": True}
            )
        except RuntimeError as error:
            raise LinearSolverError(message) from error
        if singular(np.abs(factors.U.diagonal())):
            raise LinearSolverError(message)
        return factors

    def _analyse(self, order: IntArray) -> None:
        """Lay out the whole matrix with its unknowns in this order."""
        rows, columns = self._matrix.positions()
        rank = np.argsort(order)
        off = np.flatnonzero(rows != columns)
        row = rank[np.concatenate((rows, columns[off]))]
        column = rank[np.concatenate((columns, rows[off]))]
        source = np.concatenate((np.arange(rows.size), rows.size + off))
        by_column = np.lexsort((row, column))
        counts = np.bincount(column, minlength=self._matrix.n)
        self._indptr = np.concatenate(([0], np.cumsum(counts))).astype(np.int32)
        self._indices, self._source = row[by_column].astype(np.int32), source[by_column]
        self._order = order
