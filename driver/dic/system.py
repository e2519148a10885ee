"""The normal equations of a correlation: assembled and factored once, solved for every image."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Literal

import numpy as np
from scipy.sparse import csc_array, csr_array, diags_array, hstack

from driver.dic.basis import Basis
from driver.dic.factor import DENSE, DenseFactor, Factor, Matrix, make_factor
from driver.dic.kernels import cell_pairs, pair_hessians, residual_and_right_side, shares
from driver.dic.patterns import summed_dense, summed_sparse
from driver.dic.turn import mean_gradient, mean_turn, turned
from driver.experiment.images.heightmaps import ImageError
from meshes.arrays import BoolArray, FloatArray

Reason = Literal["converged", "slow", "diverged", "left"]

CONDITION = 1e10  # of the Hessian with unit diagonal, beyond which a ridge is added
RIDGE = 1e-8  # of that unit diagonal
MAX_ITERATIONS = 60
WITHIN_NOISE = 0.3  # σ of any number that is read, less than which an update tells nothing
RESTLESS = 20  # steps, after which pixels at a border that come and go are noted
DIVERGED = 5.0  # times the first update
MIN_USED = 0.5  # of the pixels; a motion that takes more out of the image is lost
PROBED = 5000  # numbers in the random vectors behind the traces of large matrices: known to 1 %


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
        right: b of that residual, shape (n,).
        iterations: Gauss–Newton steps.
        reason: why it stopped.
        last_update: largest nodal update of u, v in the last step [px].
        last_sigma: largest update of any number that is read from the motion, over its standard
            deviation by noise; infinite where the noise was not given.
        steady: whether each pixel was compared in every step after the first `RESTLESS`, (n,).
    """

    p: FloatArray
    residual: FloatArray
    right: FloatArray
    iterations: int
    reason: Reason
    last_update: float
    last_sigma: float
    steady: BoolArray


@dataclass(frozen=True, eq=False)
class Comparison:
    """An image held against the reference at one motion.

    Attributes:
        residual: ρ at each pixel [µm], NaN where the pixel left the image or met no height.
        right: b, shape (n,).
        used: number of pixels that were compared.
    """

    residual: FloatArray
    right: FloatArray
    used: int


class System:
    """A = M + Σ a_k R_k with its factor, for one set of weights a at a time.

    Attributes:
        pixels: where the residual is taken.
        basis_uv: basis of u and of v at these pixels.
        basis_w: basis of w.
        hessian: M, symmetric, shape (n, n).
        parts: R_k, symmetric, shape (n, n).
        weights: a_k.
        ridge: what was added to the diagonal of A scaled to unit diagonal.
    """

    weights: tuple[float, ...]
    ridge: float

    def __init__(
        self, pixels: Pixels, basis_uv: Basis, basis_w: Basis, parts: Sequence[Matrix] = ()
    ) -> None:
        """Assemble the Hessian; `weigh` is to follow."""
        self.pixels, self.basis_uv, self.basis_w = pixels, basis_uv, basis_w
        self.hessian = assemble(pixels, basis_uv, basis_w)
        self.parts = tuple(parts)
        self.n_uv = len(basis_uv.nodes)
        self.size = self.hessian.shape[0]
        self._used: list[int] = []
        self._sound: tuple[float, ...] = ()
        self._factor: Factor | None = None
        self._traces: list[float] | None = None

    def at_heights(self, height: FloatArray) -> System:
        """Return the same equations, held against other heights f of the reference [µm], (n,)."""
        other = copy(self)
        other.pixels = replace(self.pixels, height=height)
        return other

    def weigh(self, weights: Sequence[float]) -> None:
        """Set the weights and factor A, with a ridge where it is singular or nearly so."""
        self.weights, self.ridge, self._traces = tuple(weights), 0.0, None
        # A part without weight is left out, as its pattern alone would fill the factor.
        used = [k for k, weight in enumerate(self.weights) if weight]
        if self._factor is None or used != self._used:
            self._factor = make_factor([self.hessian, *(self.parts[k] for k in used)])
            self._used, self._sound = used, ()
        terms = [1.0, *(self.weights[k] for k in used)]
        definite = self._factor.set(terms, 0.0)
        # More weight than where A was sound makes no direction softer.
        if definite and self._sound and np.all(np.greater_equal(self.weights, self._sound)):
            return
        if definite and self._smallest_eigenvalue() >= 1 / CONDITION:
            self._sound = self.weights
        else:
            self.ridge = RIDGE
            if not self._factor.set(terms, RIDGE):
                raise ImageError(
                    "the images do not decide the motion: the reference has no relief, or most "
                    "of the mesh lies off the region of interest."
                )

    def solve(self, right: FloatArray) -> FloatArray:
        """A⁻¹ of right-hand sides of shape (n,) or (n, m)."""
        return self._factored.solve(right)

    @property
    def _factored(self) -> Factor:
        if self._factor is None:
            raise RuntimeError("solve needs a call of weigh first")
        return self._factor

    def turn_of(self, p: FloatArray) -> float:
        """Return the angle by which nodal values turn the pixels, 0 where it is small [rad]."""
        return mean_turn(self._mean_gradient, p)

    @cached_property
    def _mean_gradient(self) -> FloatArray | None:
        """What gives the mean gradient of u and v, each node by how much the pixels tell of it."""
        uv = self.basis_uv
        return mean_gradient(uv.nodes, shares(uv.mesh.cells, uv.cell, uv.shape, self.n_uv))

    def penalty_force(self, p: FloatArray) -> FloatArray:
        """Σ a_k R_k p, shape (n,)."""
        force = np.zeros(self.size)
        for weight, part in zip(self.weights, self.parts, strict=True):
            if weight:
                force += weight * (part @ p)
        return force

    def freedom(self) -> float:
        """Trace of A⁻¹ M: how many of the n unknowns the images decide."""
        held = [w * t for w, t in zip(self.weights, self.traces(), strict=True)]
        return float(self.size - sum(held))

    def traces(self) -> list[float]:
        """Trace of A⁻¹ R_k of each part with a weight, else 0.

        Exact for a small system, else from fixed random vectors z: the mean of zᵀ(DAD)⁻¹(DR_kD)z,
        D A D of unit diagonal. Motion and height have units of their own, and without D the one
        that has the larger numbers would drown the trace of the other.
        """
        if self._traces is None:
            self._traces = self._new_traces()
        return self._traces

    def _new_traces(self) -> list[float]:
        values = [0.0] * len(self.parts)
        if not self._used:
            return values
        if isinstance(self._factor, DenseFactor):
            used = self._factor.traces()
        else:
            probes = _probes(self.size, -(-PROBED // self.size))
            scale, every = self._factored.scale[:, None], probes.shape[1]
            solved, scaled = self.solve(probes / scale), probes * scale
            used = [float(np.sum(solved * (self.parts[k] @ scaled))) / every for k in self._used]
        for k, trace in zip(self._used, used, strict=True):
            values[k] = trace
        return values

    def covariance_of(self, functionals: FloatArray, noise: Matrix) -> FloatArray:
        """L A⁻¹ N A⁻¹ Lᵀ for the rows L (m, n) and the covariance N (n, n) of the right side."""
        weights = self.solve(np.ascontiguousarray(functionals.T))
        return np.asarray(weights.T @ (noise @ weights))

    def residual(self, image: FloatArray, p: FloatArray) -> FloatArray:
        """ρ at each pixel [µm], NaN where it leaves the image or meets no height, shape (n,)."""
        return self.compare(image, p).residual

    def compare(self, image: FloatArray, p: FloatArray) -> Comparison:
        """Residual and right-hand side of an image at the nodal values p."""
        at, uv, w = self.pixels, self.basis_uv, self.basis_w
        residual, right = np.empty(len(at.rows)), np.empty(self.size)
        used = residual_and_right_side(
            image, at.rows, at.cols, 1 / at.pixel, at.height, at.slope,
            uv.mesh.cells, uv.cell, uv.shape, w.mesh.cells, w.cell, w.shape,
            p, self.n_uv, residual, right,
        )  # fmt: skip
        return Comparison(residual, right, used)

    def iterate(
        self,
        image: FloatArray,
        start: FloatArray,
        tolerance: float,
        at_start: Comparison | None = None,
        variance: float = 0.0,
    ) -> End:
        """Gauss–Newton from a start until the nodal update of u, v falls below the tolerance.

        The slopes are those of the reference. Where the motion turns by θ, those of the image are
        turned with it: with Q, which turns u and v, each step is δ = Q A⁻¹ (b − Qᵀ P p).

        An iteration that comes to no end has converged where its last step is within the noise: no
        number lᵀp moves by more than (δᵀAδ)^½ of its standard deviation (lᵀA⁻¹l)^½, over that of ρ.

        Args:
            image: cubic B-spline coefficients of g [µm], NaN where nothing was measured.
            start: nodal values [µm], (n,).
            tolerance: [px].
            at_start: `compare` at the start, if it was called.
            variance: of ρ by noise [µm²], 0 where it is not known.
        """
        p, penalised = start, any(self.weights)
        step, before, first, in_sigma = 1.0, np.inf, np.inf, np.inf
        angle = self.turn_of(start)
        reason: Reason = "slow"
        steady = np.ones(len(self.pixels.rows), dtype=bool)
        for iteration in range(1, MAX_ITERATIONS + 1):
            now = at_start if at_start and iteration == 1 else self.compare(image, p)
            if now.used < MIN_USED * len(now.residual):
                reason = "left"
                break
            if iteration > RESTLESS:
                steady &= np.isfinite(now.residual)
            right = now.right
            if penalised:
                right = right - turned(self.penalty_force(p), self.n_uv, -angle)
            unturned = self.solve(right)
            update = turned(unturned, self.n_uv, angle)
            largest = float(np.abs(update[: 2 * self.n_uv]).max()) / self.pixels.pixel
            first = min(first, largest) if iteration == 1 else first
            # M is that of the reference: where the frame is steeper, full steps overshoot.
            if largest > 0.9 * before:
                step = max(0.5 * step, 0.2)
            p, before = p + step * update, largest
            if variance:
                in_sigma = float(np.sqrt(max(float(unturned @ right), 0.0) / variance))
            if largest < tolerance:
                reason = "converged"
                break
            if largest > DIVERGED * max(first, 1.0):
                reason = "diverged"
                break
        if reason == "slow" and in_sigma < WITHIN_NOISE:
            reason = "converged"
        return End(p, now.residual, now.right, iteration, reason, before, in_sigma, steady)

    def _smallest_eigenvalue(self) -> float:
        """Of the scaled matrix, from above, by inverse iteration."""
        once = self._factored.solve_scaled(_probes(self.size, 1)[:, 0])
        twice = self._factored.solve_scaled(once)
        return float(np.linalg.norm(once) / np.linalg.norm(twice))


@lru_cache(maxsize=4)
def _probes(size: int, n: int) -> FloatArray:
    """Return fixed random signs, shape (size, n)."""
    return np.random.default_rng(0).choice([-1.0, 1.0], size=(size, n))


def assemble(pixels: Pixels, basis_uv: Basis, basis_w: Basis) -> Matrix:
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
    dofs = np.hstack([nodes_uv, nodes_uv + n_uv, nodes_w + 2 * n_uv])
    if n <= DENSE:
        return np.asarray(summed_dense(blocks, dofs, n))
    return csc_array(summed_sparse(blocks, dofs, n), shape=(n, n))


def sensitivity(gradient: FloatArray, basis_uv: Basis, basis_w: Basis) -> csr_array:
    """∇f·ψ of every function of [u | v | w], shape (n_pix, n); M is its Gram matrix.

    Args:
        gradient: ∂f/∂X, ∂f/∂Y [-], shape (n_pix, 2).
        basis_uv: basis of u and of v.
        basis_w: basis of w.
    """
    along_x, along_y = (diags_array(slope) @ basis_uv.values for slope in gradient.T)
    return csr_array(hstack([along_x, along_y, -basis_w.values]))
