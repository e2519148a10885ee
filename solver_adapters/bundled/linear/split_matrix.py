"""A square sparse matrix by its two triangles, and when a solution with it is accepted."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp

from meshes.arrays import BoolArray, FloatArray, IntArray

Backsolve = Callable[[FloatArray], FloatArray]

RESIDUAL = 1e-10
"""Largest ‖b − A x‖ / ‖b‖ that is accepted without a question."""

LARGEST_RESIDUAL = 1e-6
"""Largest ‖b − A x‖ / ‖b‖ that is accepted where rounding allows no less.

Rounding leaves about 5e-18 times the condition number (benchmarks/numerics.md).
"""

ROUNDING = 4 * float(np.finfo(np.float64).eps)
"""Largest ‖b − A x‖ / ‖|A||x| + |b|‖ that is taken for rounding.

A backward error in the sense of Oettli and Prager: such an x solves a system whose entries differ
from those of A and b by some units of rounding. Refinement reaches it whatever the condition
number (Higham, Accuracy and Stability of Numerical Algorithms, 2nd ed., 2002, sections 7.1 and
12.2).
"""


class TwoTriangles:
    """A square matrix with a symmetric pattern, whose values change in place.

    Attributes:
        n: number of rows.
        lower: values of the lower triangle, diagonal included, in the order of the pattern, (nnz,).
        upper: values of the transposed upper triangle, likewise, with the same diagonal.
    """

    def __init__(
        self, indptr: IntArray, indices: IntArray, lower: FloatArray, upper: FloatArray
    ) -> None:
        """Lay the matrix over the memory of its values (the same for both: symmetric).

        Args:
            indptr: start of each column of the lower triangle (CSC), shape (n + 1,).
            indices: row of each entry, increasing within a column and beginning with the
                diagonal, shape (nnz,).
            lower: values of the lower triangle, shape (nnz,).
            upper: values of the transposed upper triangle, shape (nnz,).
        """
        self.n = len(indptr) - 1
        self.lower, self.upper = lower, upper
        self._indptr, self._indices = indptr, indices
        self._lower = self._column_wise(lower)
        self._upper = self._column_wise(upper).T

    def _column_wise(self, values: FloatArray) -> sp.csc_array:
        pattern = (a.astype(np.int32, copy=False) for a in (self._indices, self._indptr))
        return sp.csc_array((values, *pattern), shape=(self.n, self.n))

    def product(self, x: FloatArray) -> FloatArray:
        """Return a x, shape (n,) or (n, m) as x."""
        diagonal = self.lower[self._indptr[:-1]]
        product: FloatArray = self._lower @ x + self._upper @ x - (diagonal * x.T).T
        return product

    def magnitude(self, x: FloatArray) -> FloatArray:
        """|A||x|, shape (n, m) as x."""
        absolute = TwoTriangles(self._indptr, self._indices, np.abs(self.lower), np.abs(self.upper))
        return absolute.product(np.abs(x))

    @property
    def pattern(self) -> tuple[IntArray, IntArray]:
        """Start of each column of the lower triangle, and row of each entry."""
        return self._indptr, self._indices

    def positions(self) -> tuple[IntArray, IntArray]:
        """Row and column of each value of the lower triangle, each (nnz,)."""
        return self._indices, np.repeat(np.arange(self.n), np.diff(self._indptr))

    def full(self) -> sp.csc_array:
        """Return the matrix with both triangles in one."""
        diagonal = sp.diags_array(self.lower[self._indptr[:-1]])
        return (self._lower + self._upper - diagonal).tocsc()

    def accepted(
        self, rhs: FloatArray, solution: FloatArray, residual: FloatArray, accuracy: float
    ) -> BoolArray:
        """Whether each column of a solution may be handed out.

        Its residual is at most `accuracy` of the right-hand side; or at most `LARGEST_RESIDUAL` of
        it, and no more than rounding leaves. (The second test costs a product with the matrix, and
        is made only where the first fails.)

        Args:
            rhs: b, shape (n, m).
            solution: x, shape (n, m).
            residual: b − A x, shape (n, m).
            accuracy: asked ‖b − A x‖ / ‖b‖.

        Returns:
            Shape (m,); false where a value is not finite.
        """
        size, scale = column_norms(residual), column_norms(rhs)
        accepted = size <= accuracy * scale
        doubtful = ~accepted & (size <= LARGEST_RESIDUAL * scale)
        if doubtful.any():
            floor = self.magnitude(solution[:, doubtful]) + np.abs(rhs[:, doubtful])
            accepted[doubtful] = size[doubtful] <= ROUNDING * column_norms(floor)
        return accepted


def column_norms(x: FloatArray) -> FloatArray:
    """Euclidean norm of each column of x (n, m), shape (m,), without over- or underflow."""
    largest = np.abs(x).max(axis=0, initial=0.0)
    scaled = x / np.where(largest > 0, largest, 1.0)
    norms: FloatArray = largest * np.sqrt(np.einsum("ij,ij->j", scaled, scaled))
    return norms
