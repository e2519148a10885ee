"""Sparse symmetric systems: one symbolic analysis, many factorisations, every solve checked.

CHOLMOD (in the wheel of cvxopt) factors the positive definite tangents. Where it meets an
indefinite matrix, or a solution fails the check of its residual, SuperLU takes over.
"""

from __future__ import annotations

from meshes.arrays import FloatArray, IntArray
from solver_adapters.bundled.linear.krylov import conjugate_gradients
from solver_adapters.bundled.linear.residual_check import (
    LinearSolverError,
    checked_columns,
    copy_values,
    refined,
)
from solver_adapters.bundled.linear.split_matrix import RESIDUAL, Backsolve, TwoTriangles
from solver_adapters.bundled.linear.superlu import SuperLU
from solver_adapters.cholesky import Cholesky


class SymmetricSolver:
    """Solver for a symmetric matrix whose pattern stays while its values change.

    Attributes:
        factorisations: how many times the matrix was factored.
        iterations: how many iterations of conjugate gradients led to a solution.
        fallbacks: how many times SuperLU had to replace the Cholesky factor.
    """

    factorisations: int
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
        self._cholesky = Cholesky(indptr, indices, order)
        values = self._cholesky.values
        self._matrix = TwoTriangles(indptr, indices, values, values)
        self._superlu = SuperLU(self._matrix)
        self._backsolve: Backsolve | None = None
        self._price = iterations_for_factor(len(indptr) - 1)
        # Since the last factorisation: solutions, what they cost, and what the last of them cost.
        self._served, self._spent, self._last = 0, 0, 0
        self._stale = False
        self.factorisations = self.iterations = self.fallbacks = 0

    def factor(self, values: FloatArray) -> None:
        """Factor the matrix with these values, which are copied.

        Args:
            values: entries in the order of the pattern, shape (nnz,).

        Raises:
            ValueError: the number of values is not that of the pattern.
            LinearSolverError: a value is not finite, or the matrix is singular.
        """
        self._backsolve = None
        copy_values(values, self._cholesky.values)
        self._factor()

    def update(self, values: FloatArray) -> None:
        """Set values with which one right-hand side is to be solved, roughly above all.

        The old factor stays as a preconditioner while that pays: until a solution costs more than
        the mean since the last factorisation, which included (the best time to replace what wears
        out). Then, and without a Cholesky factor, it does as `factor`. For many right-hand sides,
        or full accuracy, `factor` is faster.

        Args:
            values: entries in the order of the pattern, shape (nnz,).

        Raises:
            ValueError: the number of values is not that of the pattern.
            LinearSolverError: a value is not finite, or the matrix is factored and singular.
        """
        worn = self._last * self._served > self._price + self._spent
        if self._backsolve != self._cholesky.solve or worn:
            self.factor(values)
        else:
            self._backsolve = None
            copy_values(values, self._cholesky.values)
            self._backsolve = self._cholesky.solve
            self._stale = True

    def solve(self, rhs: FloatArray, accuracy: float = RESIDUAL) -> FloatArray:
        """Solve A x = rhs with the values of the last `factor` or `update`.

        The residual of each column is compared with its right-hand side. One above `accuracy` is
        accepted only where rounding allows no less (`TwoTriangles.accepted`); else it is met by
        iterative refinement, then by SuperLU, then by the error. After `update`, conjugate
        gradients come first; where they do not arrive soon, the matrix is factored.

        Args:
            rhs: right-hand sides, shape (n,) or (n, m).
            accuracy: largest ‖b − A x‖ / ‖b‖.

        Returns:
            The solution, shape of rhs.

        Raises:
            ValueError: the number of rows of rhs is not n.
            RuntimeError: there is no factor, since `factor` was not called or failed.
            LinearSolverError: rhs is not finite, the matrix is singular, or no solution passes the
                check.
        """
        columns = checked_columns(rhs, self._matrix.n)
        if self._backsolve is None:
            raise RuntimeError("solve needs a successful call of factor first")
        if self._stale:
            solution = self._iterate(columns, accuracy)
            if solution is not None:
                return solution.reshape(rhs.shape)
            self._factor()
        solution, error = refined(self._matrix, columns, self._backsolve, accuracy)
        if error is not None and self._backsolve == self._cholesky.solve:
            self._fall_back()
            solution, error = refined(self._matrix, columns, self._backsolve, accuracy)
        if error is not None:
            raise LinearSolverError(error)
        return solution.reshape(rhs.shape)

    def _factor(self) -> None:
        self._backsolve, self._stale = None, False
        self._served, self._spent, self._last = 1, 1, 1
        self.factorisations += 1
        if self._cholesky.factor():
            self._backsolve = self._cholesky.solve
        else:
            self._fall_back()

    def _fall_back(self) -> None:
        self._backsolve = None
        self.fallbacks += 1
        self._backsolve = self._superlu.factor()

    def _iterate(self, rhs: FloatArray, accuracy: float) -> FloatArray | None:
        """Solution (n, 1) by conjugate gradients with the old factor, or None."""
        if rhs.shape[1] != 1:
            return None
        found = conjugate_gradients(self._matrix, self._cholesky.solve, rhs, accuracy, self._price)
        if found is None:
            return None
        solution, self._last = found
        self._served += 1
        self._spent += self._last
        self.iterations += self._last
        return solution


def iterations_for_factor(n: int) -> int:
    """Return iterations of conjugate gradients in the time of a factorisation, n unknowns.

    A fit to what was measured (benchmarks/numerics.md), not taken from a clock, so that a run has
    the same digits each time.
    """
    return 10 + n // 3000
