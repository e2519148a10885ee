"""Sparse systems with a symmetric pattern and unsymmetric values, every solve checked.

The symmetric part is factored as by `SymmetricSolver`, and the true solution is iterated to; where
that does not pay, SuperLU factors the whole.
"""

from __future__ import annotations

import numpy as np

from meshes.arrays import FloatArray, IntArray
from solver_adapters.bundled.linear.krylov import skew_iteration
from solver_adapters.bundled.linear.residual_check import (
    LinearSolverError,
    checked_columns,
    copy_values,
    refined,
)
from solver_adapters.bundled.linear.split_matrix import RESIDUAL, Backsolve, TwoTriangles
from solver_adapters.bundled.linear.superlu import SuperLU
from solver_adapters.cholesky import Cholesky

DIAGONAL = 1e-10
"""Largest diagonal entry of N, relative to S, that is taken for the rounding of a sum."""


class UnsymmetricSolver:
    """Solver for A = S + N, S symmetric and N antisymmetric, whose pattern stays.

    Attributes:
        iterations: how many iterations with the factor of S led to a solution.
        fallbacks: how many times SuperLU had to replace the Cholesky factor of S.
    """

    iterations: int
    fallbacks: int

    def __init__(self, indptr: IntArray, indices: IntArray, order: IntArray | None = None) -> None:
        """Analyse the pattern of the lower triangle, diagonal included.

        Args:
            indptr: start of each column (CSC), shape (n + 1,).
            indices: row of each entry, increasing within a column and beginning with the
                diagonal, shape (nnz,).
            order: in which the unknowns may be eliminated, as of `Cholesky`, shape (n,).
        """
        self._diagonal = indptr[:-1]
        self._cholesky = Cholesky(indptr, indices, order)
        lower, upper = np.zeros(len(indices)), np.zeros(len(indices))
        self._skew = np.zeros(len(indices))
        self._matrix = TwoTriangles(indptr, indices, lower, upper)
        self._superlu = SuperLU(self._matrix)
        self._ready = False
        self._whole: Backsolve | None = None
        self._too_many = np.inf
        self.iterations = self.fallbacks = 0

    def factor(self, symmetric: FloatArray, skew: FloatArray, columns: int = 1) -> None:
        """Factor S, or the whole where that is of more use; values are copied.

        The whole is factored where S is not positive definite; and for as many columns as the
        iteration was once too slow for, or more, since one matrix is much like the next.

        Args:
            symmetric: entries S[i, j], i ≥ j, in the order of the pattern, shape (nnz,).
            skew: entries N[i, j] likewise (N[j, i] = −N[i, j]), on the diagonal no more than
                rounding, which is dropped, shape (nnz,).
            columns: right-hand sides that are to be solved for.

        Raises:
            ValueError: the number of values is not that of the pattern, or the diagonal of N is
                not zero.
            LinearSolverError: a value is not finite, or the matrix is singular.
        """
        self._ready, self._whole = False, None
        copy_values(symmetric, self._cholesky.values)
        copy_values(skew, self._skew)
        first = self._diagonal
        largest = np.abs(self._skew[first]).max()
        if largest > DIAGONAL * np.abs(symmetric[first]).max():
            raise ValueError(
                f"antisymmetric part: found {largest:.3g} on the diagonal, expected zeros"
            )
        self._skew[first] = 0.0
        np.add(symmetric, self._skew, out=self._matrix.lower)
        np.subtract(symmetric, self._skew, out=self._matrix.upper)
        if columns >= self._too_many or not self._cholesky.factor():
            self._fall_back()
        self._ready = True

    def solve(self, rhs: FloatArray, accuracy: float = RESIDUAL) -> FloatArray:
        """Solve A x = rhs with the values of the last `factor`.

        The residual is that of A. Every column is accepted or refused as by
        `SymmetricSolver.solve`; where the iteration does not arrive soon, SuperLU factors A.

        Args:
            rhs: right-hand sides, shape (n,) or (n, m).
            accuracy: largest ‖b − A x‖ / ‖b‖.

        Returns:
            The solution, shape of rhs.

        Raises:
            ValueError: the number of rows of rhs is not n.
            RuntimeError: there is no factor, since `factor` was not called or failed.
            LinearSolverError: rhs is not finite, A is singular, or no solution passes the check.
        """
        columns = checked_columns(rhs, self._matrix.n)
        if not self._ready:
            raise RuntimeError("solve needs a successful call of factor first")
        if self._whole is None:
            solution = self._iterate(columns, accuracy)
            if solution is not None:
                return solution.reshape(rhs.shape)
            if columns.shape[1] > 1:  # A single one is tried again: S costs a fraction of A.
                self._too_many = min(columns.shape[1], self._too_many)
            whole = self._fall_back()
        else:
            whole = self._whole
        solution, error = refined(self._matrix, columns, whole, accuracy)
        if error is not None:
            raise LinearSolverError(error)
        return solution.reshape(rhs.shape)

    def _iterate(self, rhs: FloatArray, accuracy: float) -> FloatArray | None:
        """Solution (n, m) with the factor of S, or None."""
        # A single column takes the time of two.
        most = columns_for_superlu(self._matrix.n) // max(rhs.shape[1], 2)
        found = skew_iteration(self._matrix, self._cholesky.solve, rhs, accuracy, most)
        if found is None:
            return None
        solution, iterations = found
        self.iterations += iterations
        return solution

    def _fall_back(self) -> Backsolve:
        self.fallbacks += 1
        self._whole = self._superlu.factor()
        return self._whole


def columns_for_superlu(n: int) -> int:
    """Columns solved in blocks with the factor of S while SuperLU factors A, n unknowns.

    A fit to what was measured (benchmarks/numerics.md), not taken from a clock, so that a run has
    the same digits each time.
    """
    return 100 + n // 80
