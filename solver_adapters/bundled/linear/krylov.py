"""Iterations to the solution of a sparse system with the factor of another, near matrix.

Each gives up as soon as its residual falls behind the pace that would bring it there in time.
"""

from __future__ import annotations

import numpy as np

from meshes.arrays import FloatArray
from solver_adapters.bundled.linear.split_matrix import Backsolve, TwoTriangles

PATIENCE = 4
"""Iterations that may be behind the pace."""


def conjugate_gradients(
    matrix: TwoTriangles, precondition: Backsolve, rhs: FloatArray, accuracy: float, most: int
) -> tuple[FloatArray, int] | None:
    """Solve A x = rhs for a positive definite A, preconditioned.

    Args:
        matrix: A.
        precondition: r ↦ M⁻¹ r for a positive definite M near A, (n, 1) to (n, 1).
        rhs: shape (n, 1).
        accuracy: asked ‖rhs − A x‖ / ‖rhs‖.
        most: largest number of iterations.

    Returns:
        The solution (n, 1), its residual checked, and the number of iterations; or None where A
        shows itself not to be positive definite, a value is not finite, or the residual will not
        be small enough within `most`.
    """
    largest = float(np.abs(rhs).max())
    if largest == 0.0:
        return np.zeros_like(rhs), 0
    residual = rhs / largest
    start = float(np.linalg.norm(residual))
    solution, direction, old = np.zeros_like(rhs), np.zeros_like(rhs), np.inf
    # A useless preconditioner may give anything, infinities included: the curvature tells.
    with np.errstate(over="ignore", invalid="ignore"):
        for iteration in range(1, most + 1):
            correction = precondition(residual)
            new = float(np.vdot(residual, correction))
            direction = correction + new / old * direction
            image = matrix.product(direction)
            curvature = float(np.vdot(direction, image))
            if not 0.0 < curvature < np.inf:
                return None
            solution = solution + new / curvature * direction
            residual = residual - new / curvature * image
            error = float(np.linalg.norm(residual)) / start
            if error <= accuracy:
                solution = largest * solution
                true = rhs - matrix.product(solution)
                good = matrix.accepted(rhs, solution, true, accuracy).all()
                return (solution, iteration) if good else None
            if iteration >= PATIENCE and not error <= accuracy ** (iteration / most):
                return None
            old = new
    return None


def skew_iteration(
    matrix: TwoTriangles, solve_symmetric: Backsolve, rhs: FloatArray, accuracy: float, most: int
) -> tuple[FloatArray, int] | None:
    """Solve (S + N) x = rhs, S positive definite, N antisymmetric, with the factor of S.

    In the inner product of S, S⁻¹N is antisymmetric: a Galerkin projection on the Krylov space
    needs no more than a recurrence of three terms, and cannot break down (Concus and Golub,
    Lecture Notes in Economics and Mathematical Systems 134, 1976; Widlund, SIAM J. Numer. Anal. 15,
    1978). With Λ the spectral radius of S⁻¹N, an iteration gains a factor of Λ / (1 + √(1 + Λ²)).
    The residual is formed from x, not carried along; the pace is that of √(rᵀS⁻¹r), which is
    smoother.

    Args:
        matrix: S + N.
        solve_symmetric: b ↦ S⁻¹ b, (n, m) to (n, m).
        rhs: shape (n, m).
        accuracy: asked ‖rhs − (S + N) x‖ / ‖rhs‖ of each column.
        most: largest number of iterations.

    Returns:
        The solution (n, m), its residuals checked, and the number of iterations; or None where
        they will not be small enough within `most`.
    """
    before = solution = np.zeros_like(rhs)
    columns = rhs.shape[1]
    first, old, weight = np.zeros(columns), np.zeros(columns), np.ones(columns)
    residual = rhs
    # A useless factor may give anything, infinities included: they are not accepted.
    with np.errstate(over="ignore", invalid="ignore"):
        for iteration in range(1, most + 1):
            correction = solve_symmetric(residual)
            new = np.einsum("ij,ij->j", residual, correction)
            if iteration == 1:
                first = new
            elif iteration > PATIENCE:
                pace = accuracy ** (2 * (iteration - 1) / most)
                if not np.all(new <= pace * first):
                    return None
            # The first iteration is a plain solution; a column without a residual needs no more.
            ratio = np.divide(new, old, out=np.zeros(columns), where=old > 0)
            weight = 1.0 / (1.0 + ratio / weight)
            before, solution = solution, before + weight * (correction + solution - before)
            residual = rhs - matrix.product(solution)
            if matrix.accepted(rhs, solution, residual, accuracy).all():
                return solution, iteration
            old = new
    return None
