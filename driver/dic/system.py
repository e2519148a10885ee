"""The normal equations of a correlation: assembled and factored once, solved for every image."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse import coo_array, csc_array, diags_array, tril

from driver.dic.basis import Basis
from driver.dic.kernels import cell_pairs, pair_hessians, residual_and_right_side
from solver_adapters.bundled.cholesky import Cholesky

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

Reason = Literal["converged", "slow", "diverged", "left"]

DENSE = 400  # unknowns, up to which a dense factor is faster than a sparse one
CONDITION = 1e10  # of the Hessian with unit diagonal, beyond which a ridge is added
RIDGE = 1e-8  # of that unit diagonal
MAX_ITERATIONS = 60
DIVERGED = 5.0  # times the first update
MIN_USED = 0.5  # of the pixels; a motion that takes more out of the image is lost
PROBES = 32  # random vectors behind the trace of a large matrix: 2 % of the trace for n = 1000


@dataclass(frozen=True, eq=False)
class Pixels:
    """Reference at the n pixels of the region of interest.

    Attributes:
        rows: place of each pixel in the images [px], (n,).
        cols: the same along the columns, (n,).
        height: f [µm], (n,).
        slope: ∂f/∂X (along the rows' index), ∂f/∂Y [-], (n, 2).
        pixel: size of a pixel [µm].
    """

    rows: FloatArray
    cols: FloatArray
    height: FloatArray
    slope: FloatArray
    pixel: float


@dataclass(frozen=True, eq=False)
class End:
    """Where the iteration of one image ended.

    Attributes:
        p: nodal values [u | v | w] [µm], shape (n,).
        residual: ρ at each pixel [µm], NaN where the pixel left the image or met no height.
        iterations: Gauss–Newton steps.
        reason: why it stopped.
        last_update: largest nodal update of u, v in the last step [px].
    """

    p: FloatArray
    residual: FloatArray
    iterations: int
    reason: Reason
    last_update: float


class System:
    """(M + P) with its factor.

    Attributes:
        pixels: where the residual is taken.
        basis_uv, basis_w: bases at these pixels.
        hessian: M, symmetric, shape (n, n).
        penalty: P, shape (n, n).
        ridge: what was added to the diagonal of M + P scaled to unit diagonal.
    """

    def __init__(
        self,
        pixels: Pixels,
        basis_uv: Basis,
        basis_w: Basis,
        hessian: csc_array,
        penalty: csc_array,
    ) -> None:
        """Factor M + P, with a ridge where it is singular or nearly so."""
        self.pixels, self.basis_uv, self.basis_w = pixels, basis_uv, basis_w
        self.hessian, self.penalty = hessian, penalty
        self.n_uv = len(basis_uv.nodes)
        total = csc_array(hessian + penalty)
        diagonal = total.diagonal()
        self._scale = np.sqrt(np.where(diagonal > 0, diagonal, diagonal.max()))
        weights = diags_array(1 / self._scale)
        scaled = csc_array(weights @ total @ weights)
        self.ridge = 0.0
        self._factor = _factor(scaled)
        if self._factor is None or self._smallest_eigenvalue() < 1 / CONDITION:
            self.ridge = RIDGE
            self._factor = _factor(csc_array(scaled + RIDGE * diags_array(np.ones(len(diagonal)))))

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return len(self._scale)

    def with_penalty(self, penalty: csc_array) -> System:
        """The same Hessian with another penalty, factored anew."""
        return System(self.pixels, self.basis_uv, self.basis_w, self.hessian, penalty)

    def solve(self, right: FloatArray) -> FloatArray:
        """(M + P)⁻¹ of right-hand sides of shape (n,) or (n, m)."""
        columns = right.reshape(self.size, -1) / self._scale[:, None]
        assert self._factor is not None
        if isinstance(self._factor, Cholesky):
            solution = self._factor.solve(columns)
        else:
            solution = cho_solve(self._factor, columns, check_finite=False)
        return np.asarray((solution / self._scale[:, None]).reshape(right.shape))

    def freedom(self) -> float:
        """Trace of (M + P)⁻¹ M: how many of the n unknowns the images decide."""
        if not self.penalty.nnz and not self.ridge:
            return float(self.size)
        return self.size - self.penalty_trace(self.penalty)

    def penalty_trace(self, part: csc_array) -> float:
        """Trace of (M + P)⁻¹ Q: exact for a small system, else from fixed random vectors."""
        if self.size <= 4 * DENSE:
            return float(self.solve(part.toarray()).trace())
        probes = np.random.default_rng(0).choice([-1.0, 1.0], size=(self.size, PROBES))
        return float(np.sum(probes * self.solve(np.asarray(part @ probes))) / PROBES)

    def covariance_of(self, functionals: FloatArray) -> FloatArray:
        """L (M+P)⁻¹ M (M+P)⁻¹ Lᵀ for the rows L (m, n), times σ² the covariance of L p."""
        weights = self.solve(np.ascontiguousarray(functionals.T))
        return np.asarray(weights.T @ (self.hessian @ weights))

    def residual(self, image: FloatArray, p: FloatArray) -> FloatArray:
        """ρ at each pixel [µm], NaN where it leaves the image or meets no height, shape (n,)."""
        return self._residual_and_right(image, p)[0]

    def _residual_and_right(
        self, image: FloatArray, p: FloatArray
    ) -> tuple[FloatArray, FloatArray, int]:
        at, uv, w = self.pixels, self.basis_uv, self.basis_w
        residual, right = np.empty(len(at.rows)), np.empty(self.size)
        used = residual_and_right_side(
            image, at.rows, at.cols, 1 / at.pixel, at.height, at.slope,
            uv.mesh.cells, uv.cell, uv.shape, w.mesh.cells, w.cell, w.shape,
            p, self.n_uv, residual, right,
        )  # fmt: skip
        return residual, right, used

    def iterate(
        self, image: FloatArray, start: FloatArray, tolerance: float, pull: FloatArray | float = 0.0
    ) -> End:
        """Gauss–Newton from a start until the nodal update of u, v falls below the tolerance.

        Args:
            image: cubic B-spline coefficients of g [µm], NaN where nothing was measured.
            start: nodal values [µm], (n,).
            tolerance: [px].
            pull: P p₀ of a penalty on (p − p₀), (n,).
        """
        p, penalised = start, bool(self.penalty.nnz)
        step, before, first = 1.0, np.inf, np.inf
        reason: Reason = "slow"
        for iteration in range(1, MAX_ITERATIONS + 1):
            residual, right, used = self._residual_and_right(image, p)
            if used < MIN_USED * len(residual):
                return End(p, residual, iteration, "left", before)
            update = self.solve(right + pull - self.penalty @ p if penalised else right)
            largest = float(np.abs(update[: 2 * self.n_uv]).max()) / self.pixels.pixel
            first = min(first, largest) if iteration == 1 else first
            # M is that of the reference: where the frame is steeper, full steps overshoot.
            if largest > 0.9 * before:
                step = max(0.5 * step, 0.2)
            p, before = p + step * update, largest
            if largest < tolerance:
                reason = "converged"
                break
            if largest > DIVERGED * max(first, 1.0):
                reason = "diverged"
                break
        return End(p, residual, iteration, reason, before)

    def _smallest_eigenvalue(self) -> float:
        """Of the scaled matrix, from above, by inverse iteration."""
        vector = np.random.default_rng(0).normal(size=(self.size, 1))
        assert self._factor is not None
        grown = 1.0
        for _ in range(3):
            vector = vector / np.linalg.norm(vector)
            if isinstance(self._factor, Cholesky):
                vector = self._factor.solve(vector)
            else:
                vector = cho_solve(self._factor, vector, check_finite=False)
            grown = float(np.linalg.norm(vector))
        return 1 / grown


def assemble(pixels: Pixels, basis_uv: Basis, basis_w: Basis) -> csc_array:
    """M_ij = Σ (∇f·ψ_i)(∇f·ψ_j) for [u | v | w], ∇f = (∂f/∂X, ∂f/∂Y, −1), shape (n, n)."""
    cells_uv, cells_w = basis_uv.mesh.cells, basis_w.mesh.cells
    pair, sample, count = cell_pairs(basis_uv.cell, basis_w.cell, len(cells_w))
    if count < 0:
        key = basis_uv.cell * len(cells_w) + basis_w.cell
        _, sample, pair = np.unique(key, return_index=True, return_inverse=True)
        pair, count = pair.ravel(), len(sample)
    blocks = pair_hessians(pair, count, pixels.slope, basis_uv.shape, basis_w.shape)
    n_uv, n = len(basis_uv.nodes), 2 * len(basis_uv.nodes) + len(basis_w.nodes)
    of = sample[:count]
    nodes_uv, nodes_w = cells_uv[basis_uv.cell[of]], cells_w[basis_w.cell[of]]
    dofs = np.hstack([nodes_uv, nodes_uv + n_uv, nodes_w + 2 * n_uv]).astype(np.int32)
    i, j = np.tril_indices(dofs.shape[1])
    values, rows, cols = blocks[:, i, j].ravel(), dofs[:, i].ravel(), dofs[:, j].ravel()
    del blocks
    lower = coo_array((values, (np.maximum(rows, cols), np.minimum(rows, cols))), shape=(n, n))
    lower = csc_array(lower)
    upper = lower.T.tocsc()
    upper.setdiag(0.0)
    return csc_array(lower + upper)


def _factor(scaled: csc_array) -> Cholesky | tuple[FloatArray, bool] | None:
    """Cholesky factor of a symmetric matrix, or None if it is not positive definite."""
    if scaled.shape[0] <= DENSE:
        try:
            factor: tuple[FloatArray, bool] = cho_factor(scaled.toarray(), lower=True)
        except np.linalg.LinAlgError:
            return None
        return factor
    lower = csc_array(tril(scaled, format="csc"))
    lower.sort_indices()
    if np.any(lower.indices[lower.indptr[:-1]] != np.arange(scaled.shape[0])):
        return None  # an empty diagonal: a function that sees no pixel
    sparse = Cholesky(lower.indptr.astype(np.int64), lower.indices.astype(np.int64))
    sparse.values[:] = lower.data
    return sparse if sparse.factor() else None
