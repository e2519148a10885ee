"""What every sparse solver of this package checks: values, right-hand sides, residuals, pivots."""

from __future__ import annotations

import numpy as np

from meshes.arrays import FloatArray
from solver_adapters.bundled.linear.split_matrix import Backsolve, TwoTriangles, column_norms
from solver_adapters.interface import SolverError

REFINEMENTS = 2
"""Steps of iterative refinement before the fallback, or the error."""


class LinearSolverError(SolverError):
    """A linear system without a trustworthy solution: singular, not finite, or too ill-conditioned.

    In a Newton iteration the remedy is a smaller time step.
    """


def copy_values(values: FloatArray, target: FloatArray) -> None:
    """Copy values of a sparse matrix to where they are used, if they can be used."""
    if values.shape != target.shape:
        raise ValueError(
            f"values of a sparse matrix: found shape {values.shape}, "
            f"expected {target.shape}, one for each entry of the pattern"
        )
    if not np.isfinite(values).all():
        raise LinearSolverError("the matrix has a value that is not finite")
    target[:] = values


def checked_columns(rhs: FloatArray, n: int) -> FloatArray:
    """Right-hand sides as columns (n, m), if there can be a solution."""
    if rhs.ndim not in (1, 2) or len(rhs) != n:
        raise ValueError(f"right-hand side: found shape {rhs.shape}, expected ({n},) or ({n}, m)")
    if not np.isfinite(rhs).all():
        raise LinearSolverError("the right-hand side has a value that is not finite")
    return rhs.reshape(n, 1) if rhs.ndim == 1 else rhs


def refined(
    matrix: TwoTriangles, rhs: FloatArray, backsolve: Backsolve, accuracy: float
) -> tuple[FloatArray, str | None]:
    """Solution (n, m) after as many refinements as needed, and what is wrong with it."""
    # A useless factor may give anything, infinities included: they are not accepted.
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        solution = backsolve(rhs)
        for step in range(REFINEMENTS + 1):
            residual = rhs - matrix.product(solution)
            wrong = ~matrix.accepted(rhs, solution, residual, accuracy)
            if not wrong.any():
                return solution, None
            if step < REFINEMENTS:
                solution = solution + backsolve(residual)
        error = float((column_norms(residual) / column_norms(rhs))[wrong].max())
    return solution, (
        f"linear system of {matrix.n} unknowns: relative residual {error:.1e}, expected at most "
        f"{accuracy:.0e}, or what rounding leaves: the matrix is too ill-conditioned"
    )
