"""Sparse symmetric systems: one symbolic analysis, many factorisations, every solve checked.

CHOLMOD (in the wheel of cvxopt) factors the positive definite tangents. Where it meets an
indefinite matrix, or a solution fails the check of its residual, SuperLU takes over.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp
from cvxopt import cholmod, matrix, spmatrix
from scipy.sparse.linalg import splu

from solver_adapters.interface import FloatArray, IntArray, SolverError

RESIDUAL = 1e-10
"""Largest accepted ‖b − A x‖ / ‖b‖ of any right-hand side."""

REFINEMENTS = 2
"""Steps of iterative refinement before the fallback, or the error."""


class LinearSolverError(SolverError):
    """A linear system without a trustworthy solution: singular, not finite, or too ill-conditioned.

    In a Newton iteration the remedy is a smaller time step.
    """


class SymmetricSolver:
    """Direct solver for a symmetric matrix whose pattern stays while its values change.

    Attributes:
        fallbacks: how many times SuperLU had to replace the Cholesky factor.
    """

    fallbacks: int

    def __init__(self, indptr: IntArray, indices: IntArray) -> None:
        """Analyse the pattern of the lower triangle, diagonal included.

        Args:
            indptr: start of each column (CSC), shape (n + 1,).
            indices: row of each entry, increasing within a column and beginning with the
                diagonal, shape (nnz,).
        """
        self._n = len(indptr) - 1
        self._diagonal = indptr[:-1]
        # One buffer under both the CHOLMOD matrix and the SciPy view: values are copied in once.
        self._buffer = matrix(0.0, (len(indices), 1))
        self._values: FloatArray = np.asarray(self._buffer)[:, 0]
        self._lower = sp.csc_array(
            (self._values, indices.astype(np.int32), indptr.astype(np.int32)),
            shape=(self._n, self._n),
        )
        self._upper = self._lower.T
        columns = np.repeat(np.arange(self._n), np.diff(indptr))
        rows = matrix(indices.astype(np.int64))
        self._matrix = spmatrix(1.0, rows, matrix(columns), (self._n, self._n))
        self._cholesky = cholmod.symbolic(self._matrix)
        self._backsolve: Callable[[FloatArray], FloatArray] | None = None
        self.fallbacks = 0

    def factor(self, values: FloatArray) -> None:
        """Factor the matrix with these values, which are copied.

        Args:
            values: entries in the order of the pattern, shape (nnz,).

        Raises:
            ValueError: the number of values is not that of the pattern.
            LinearSolverError: a value is not finite, or the matrix is singular.
        """
        self._backsolve = None
        if values.shape != self._values.shape:
            raise ValueError(
                f"values of a sparse matrix: found shape {values.shape}, "
                f"expected {self._values.shape}, one for each entry of the pattern"
            )
        if not np.isfinite(values).all():
            raise LinearSolverError("the matrix has a value that is not finite")
        self._values[:] = values
        self._matrix.V = self._buffer
        try:
            cholmod.numeric(self._matrix, self._cholesky)
        except ArithmeticError:  # a pivot that is not positive
            self._fall_back()
            return
        pivots = np.asarray(cholmod.diag(self._cholesky))[:, 0] ** 2
        if self._singular(pivots):
            self._fall_back()
        else:
            self._backsolve = self._cholesky_backsolve

    def solve(self, rhs: FloatArray) -> FloatArray:
        """Solve A x = rhs with the values of the last `factor`.

        The residual of each column is compared with its right-hand side. A residual above
        `RESIDUAL` is met by iterative refinement, then by SuperLU, then by the error. (Rounding
        alone leaves about 5e-18 times the condition number: 1e-10 asks for less than some 1e7.)

        Args:
            rhs: right-hand sides, shape (n,) or (n, m).

        Returns:
            The solution, shape of rhs.

        Raises:
            ValueError: the number of rows of rhs is not n.
            RuntimeError: there is no factor, since `factor` was not called or failed.
            LinearSolverError: rhs is not finite, or no solution passes the check.
        """
        if rhs.ndim not in (1, 2) or len(rhs) != self._n:
            raise ValueError(
                f"right-hand side: found shape {rhs.shape}, expected ({self._n},) or ({self._n}, m)"
            )
        if self._backsolve is None:
            raise RuntimeError("solve needs a successful call of factor first")
        if not np.isfinite(rhs).all():
            raise LinearSolverError("the right-hand side has a value that is not finite")
        columns = rhs.reshape(self._n, 1) if rhs.ndim == 1 else rhs
        solution, error = self._refined(columns, self._backsolve)
        if not error <= RESIDUAL and self._backsolve == self._cholesky_backsolve:
            solution, error = self._refined(columns, self._fall_back())
        if not error <= RESIDUAL:
            raise LinearSolverError(
                f"linear system of {self._n} unknowns: relative residual {error:.1e}, "
                f"expected at most {RESIDUAL:.0e}: the matrix is too ill-conditioned"
            )
        return solution.reshape(rhs.shape)

    def _refined(
        self, rhs: FloatArray, backsolve: Callable[[FloatArray], FloatArray]
    ) -> tuple[FloatArray, float]:
        """Solution (n, m) after as many refinements as needed, and its largest residual."""
        scale = np.maximum(_column_norms(rhs), np.finfo(np.float64).tiny)
        # A useless factor may give anything, infinities included: the ratio then is not finite.
        with np.errstate(over="ignore", invalid="ignore"):
            solution = backsolve(rhs)
            for step in range(REFINEMENTS + 1):
                residual = rhs - self._product(solution)
                error = float((_column_norms(residual) / scale).max(initial=0.0))
                if error <= RESIDUAL or step == REFINEMENTS:
                    break
                solution = solution + backsolve(residual)
        return solution, error

    def _product(self, x: FloatArray) -> FloatArray:
        """A x from the lower triangle alone, shape (n, m)."""
        diagonal = self._values[self._diagonal, np.newaxis]
        product: FloatArray = self._lower @ x + self._upper @ x - diagonal * x
        return product

    def _cholesky_backsolve(self, rhs: FloatArray) -> FloatArray:
        solution = matrix(rhs)
        cholmod.solve(self._cholesky, solution)
        return np.ascontiguousarray(solution)

    def _fall_back(self) -> Callable[[FloatArray], FloatArray]:
        """Factor with SuperLU, in whose symmetric mode pivots stay near the diagonal."""
        self._backsolve = None
        self.fallbacks += 1
        full = self._lower + self._upper - sp.diags_array(self._values[self._diagonal])
        try:
            factors = splu(
                full.tocsc(),
                permc_spec="MMD_AT_PLUS_A",
                diag_pivot_thresh=0.01,
                options={"SymmetricMode": True},
            )
        except RuntimeError as error:
            raise LinearSolverError(f"singular matrix of {self._n} unknowns") from error
        if self._singular(np.abs(factors.U.diagonal())):
            raise LinearSolverError(f"singular matrix of {self._n} unknowns")
        backsolve: Callable[[FloatArray], FloatArray] = factors.solve
        self._backsolve = backsolve
        return backsolve

    def _singular(self, pivots: FloatArray) -> bool:
        """Whether a pivot is no more than rounding (a small residual alone cannot tell)."""
        return bool(pivots.min() <= self._n * np.finfo(np.float64).eps * pivots.max())


def _column_norms(x: FloatArray) -> FloatArray:
    norms: FloatArray = np.sqrt(np.einsum("ij,ij->j", x, x))
    return norms
