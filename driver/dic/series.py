"""Global digital image correlation of a series of height maps."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, diags_array, hstack

from driver.dic.basis import Basis, grid_basis, mesh_basis
from driver.dic.first_pass import TOLERANCE_FIRST, first_pass
from driver.dic.interpolation_noise import mean_autocorrelation, noise_of_right_side
from driver.dic.messages import explanation
from driver.dic.missing_pixels import Equations
from driver.dic.regularisation import Penalty, penalties, ranks
from driver.dic.regularisation_evidence import Evidence, NoiseAndRoughness
from driver.dic.resolution_check import refuse_too_fine
from driver.dic.surface_images import SurfaceImages, refine_gradient
from driver.dic.system import End, Pixels, System
from meshes.plane_mesh import PlaneMesh

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
Roughness = float | Literal["estimated"] | None

ELEMENT_UV = 16  # px
ELEMENT_W = 8  # px; slip steps and grains make the height vary faster than u, v
ROUGHNESS = 1.0  # px; a jump of 6 % in strain between two elements of 16 px
ROUGHNESS_FIRST = 0.05  # px; nearly affine: no local minimum for the first pass to fall into
TOLERANCE = 1e-4  # px; largest nodal update of u, v at convergence


@dataclass(frozen=True, eq=False)
class SurfaceMotion:
    """Measured motion of the surface in T frames.

    Attributes:
        basis_uv: basis of u and of v, n_uv functions.
        basis_w: basis of w, n_w functions.
        coefficients: nodal values [µm], ordered [u | v | w], shape (T, n), n = 2 n_uv + n_w.
        covariance_one: covariance that the noise of one frame causes [µm²], shape (n, n):
            σ² A⁻¹ N A⁻¹ with A = M + P and N the noise of the right-hand side, M but for what
            interpolation smoothes, see `noise_of_right_side`. Between the frames t and t' the
            measured motion has the covariance covariance_one · (δ_tt' + 1/n_reference): all share
            the noise of the reference. A frame with pixels that were not compared has more, and
            the error of the flat pattern adds its own: `covariance_in_time` has both.
        shared_noise: autocorrelation of a frame's noise as it is read between the pixels, by
            distance [px], see `mean_autocorrelation`.
        n_reference: number of images averaged into the reference.
        chi: residual in units of noise, degrees of freedom counted, shape (T,). The relief stands
            for the residual of a frame that is lost.
        lost: whether most of the face left the frame or the iteration diverged, shape (T,).
        iterations: Gauss–Newton steps of the last pass, shape (T,).
        converged: whether the update fell below the tolerance, shape (T,).
        reason: why the iteration of each frame ended, length T.
        roughness: standard deviation granted to what is penalised of u, v [µm].
        ridge: what was added to the diagonal of the Hessian scaled to unit diagonal;
            0 if it was well conditioned.
        compared: whether each pixel entered the motion of each frame, shape (T, n_pix): not where
            the frame has no height there or ends before it.
        equations: normal equations of the last pass.
    """

    basis_uv: Basis
    basis_w: Basis
    coefficients: FloatArray
    covariance_one: FloatArray
    shared_noise: FloatArray
    n_reference: int
    chi: FloatArray
    lost: BoolArray
    iterations: IntArray
    converged: BoolArray
    reason: tuple[str, ...]
    roughness: float
    ridge: float
    compared: BoolArray
    equations: Equations

    @property
    def system(self) -> System:
        """The equations of a frame that has every pixel."""
        return self.equations.whole

    def at_pixels(self) -> FloatArray:
        """u, v, w at the pixels of the region of interest [µm], shape (T, n_pix, 3)."""
        return _expand(self.basis_uv, self.basis_w, self.coefficients)


def measure(
    images: SurfaceImages,
    size_uv: float | PlaneMesh | None = None,
    size_w: float | PlaneMesh | None = None,
    roughness: Roughness = None,
    workers: int = 1,
    penalty: Penalty | None = None,
) -> SurfaceMotion:
    """Measure u, v, w of every frame against the reference.

    The residual is ρ = f + w − g(x + u, y + v). With ∇f = (∂f/∂x, ∂f/∂y, −1) and the nodal
    functions ψ of all three components, each step solves (M + P) δ = b − P p,

        M_ij = Σ (∇f·ψ_i)(∇f·ψ_j),    b_i = Σ (∇f·ψ_i) ρ,

    factored once for all frames. P = σ²(1 + 1/n) R/roughness², with R the penalty of
    `regularisation`, keeps modes in bounds that a weak pattern leaves to the noise. "tikhonov" and
    "equilibrium_gap" cost nothing for an affine motion, so a uniform elongation is not biased.

    A height change shorter than about three elements of w does not fit its basis and pulls on
    u, v in proportion to itself, well before χ shows it: choose `size_w` by the topography.

    The regularisation is ramped down. The first pass starts each frame from the last one that
    was followed and the rigid shift between the two, stiffly, with the gradient of the smoothed
    reference and a penalty that leaves affine motions free. The second takes the gradient from all
    images, warped back, and relaxes to `roughness`, by way of 1 pixel where that is estimated.

    A pixel without a height in one frame is left out of ρ, b and M of that frame alone. A frame
    that is lost has no say in the roughness nor in what is stated of the noise.

    Args:
        images: the series.
        size_uv: element size of u and v [µm]; 16 pixels if None; or their mesh.
        size_w: element size of w [µm]; 8 pixels if None; or its mesh.
        roughness: standard deviation granted to what is penalised [µm]; 1 pixel if None, infinity
            for no penalty; "estimated" for what makes the images most probable.
        workers: threads over the frames; the result does not depend on it.
        penalty: of u and v; None for "tikhonov" on a grid and "equilibrium_gap" elsewhere.

    Raises:
        ImageError: more nodal values than the pixels can decide or memory has room for.
    """
    pixel = images.pixel
    basis_uv = basis_on(images, size_uv or ELEMENT_UV * pixel)
    basis_w = basis_on(images, size_w or ELEMENT_W * pixel)
    refuse_too_fine(len(images.xy), len(basis_uv.nodes), len(basis_w.nodes))
    variance = images.sigma**2 * (1.0 + 1.0 / images.n_reference)
    first = ROUGHNESS_FIRST * pixel
    if isinstance(roughness, float):
        first = min(roughness, first)
    system = _system(images, basis_uv, basis_w, "tikhonov")
    system.weigh([variance / first**2])
    starts = first_pass(images, system)
    images = refine_gradient(images, _expand(basis_uv, basis_w, starts))
    system = _system(images, basis_uv, basis_w, penalty)
    relief = float(np.var(images.reference))
    bending = penalties(basis_uv, basis_w, penalty)[1]
    equations = Equations(system, bending, variance / relief)

    def solve(starts: FloatArray, tolerance: float) -> list[End]:
        def one(spline: FloatArray, start: FloatArray) -> End:
            return equations.solve(spline, start, tolerance)

        if workers == 1:
            return list(map(one, images.frames.coefficients, starts))
        with ThreadPoolExecutor(workers) as pool:
            return list(pool.map(one, images.frames.coefficients, starts))

    if roughness == "estimated":
        system.weigh([variance / (ROUGHNESS * pixel) ** 2])
        ends = solve(starts, TOLERANCE_FIRST)
        heard = _heard(ends)
        p = np.array([end.p for end in ends])[heard]
        targets = np.array([system.hessian @ q + system.penalty_force(q) for q in p])
        rank = ranks(basis_uv, basis_w, penalty)
        evidence = Evidence(system, targets, 0.0, rank, (True, False), images.n_reference)
        # The height has no penalty here.
        guess = NoiseAndRoughness(images.sigma, ROUGHNESS * pixel, roughness_w=1.0)
        estimate, starts[heard] = evidence.settle(p, guess, images.sigma)
        granted = estimate.roughness
    else:
        granted = ROUGHNESS * pixel if roughness is None else roughness
    system.weigh([variance / granted**2])
    ends = solve(starts, TOLERANCE)
    coefficients = np.array([end.p for end in ends])
    motion = _expand(basis_uv, basis_w, coefficients)
    residuals, lost = np.array([end.residual for end in ends]), _lost(ends)
    compared = np.isfinite(residuals)
    residuals[lost] = images.reference - images.reference.mean()
    squares = residuals**2 / images.expected_residual_variance(motion)
    left = np.maximum(np.isfinite(squares).sum(axis=1) - system.freedom(), 1.0)
    shared = mean_autocorrelation(motion[_heard(ends)] / pixel)
    seen = sensitivity(images.gradient, basis_uv, basis_w)
    noise = noise_of_right_side(seen, images.rows, images.cols, shared, images.n_reference)
    return SurfaceMotion(
        basis_uv=basis_uv,
        basis_w=basis_w,
        coefficients=coefficients,
        covariance_one=images.sigma**2 * system.covariance_of(np.eye(system.size), noise),
        shared_noise=shared,
        n_reference=images.n_reference,
        chi=np.sqrt(np.nansum(squares, axis=1) / left),
        lost=lost,
        iterations=np.array([end.iterations for end in ends]),
        converged=np.array([end.reason == "converged" for end in ends]),
        reason=tuple(explanation(end, TOLERANCE) for end in ends),
        roughness=granted,
        ridge=system.ridge,
        compared=compared,
        equations=equations,
    )


def _lost(ends: Sequence[End]) -> BoolArray:
    return np.array([end.reason in ("left", "diverged") for end in ends])


def _heard(ends: Sequence[End]) -> BoolArray:
    """Return the frames that are not lost; all where none is left."""
    lost = _lost(ends)
    return lost if lost.all() else ~lost


def basis_on(images: SurfaceImages, size: float | PlaneMesh) -> Basis:
    """Return the basis of a component over the region of interest.

    Args:
        images: the series.
        size: of the elements of a regular grid [µm], or a mesh that holds all pixels.
    """
    if isinstance(size, PlaneMesh):
        return mesh_basis(images.xy, size)
    return grid_basis(images.xy, images.bounds, size)


def _system(
    images: SurfaceImages, basis_uv: Basis, basis_w: Basis, penalty: Penalty | None
) -> System:
    origin = images.frames.origin
    pixels = Pixels(
        rows=images.xy[:, 0] / images.pixel + origin[0],
        cols=images.xy[:, 1] / images.pixel + origin[1],
        height=images.reference,
        slope=np.ascontiguousarray(images.gradient),
        pixel=images.pixel,
    )
    return System(pixels, basis_uv, basis_w, penalties(basis_uv, basis_w, penalty)[:1])


def sensitivity(gradient: FloatArray, basis_uv: Basis, basis_w: Basis) -> csr_array:
    """∇f·ψ of every function of [u | v | w], shape (n_pix, n); M is its Gram matrix.

    Args:
        gradient: ∂f/∂X, ∂f/∂Y [-], shape (n_pix, 2).
        basis_uv: basis of u and of v.
        basis_w: basis of w.
    """
    along_x, along_y = (diags_array(slope) @ basis_uv.values for slope in gradient.T)
    return csr_array(hstack([along_x, along_y, -basis_w.values]))


def _expand(basis_uv: Basis, basis_w: Basis, p: FloatArray) -> FloatArray:
    n = basis_uv.values.shape[1]
    parts = ((basis_uv, p[:, :n]), (basis_uv, p[:, n : 2 * n]), (basis_w, p[:, 2 * n :]))
    return np.stack([(basis.values @ q.T).T for basis, q in parts], axis=-1)
