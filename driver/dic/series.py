"""Global digital image correlation of a series of height maps."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, diags_array, hstack

from driver.dic.basis import Basis, grid_basis, mesh_basis
from driver.dic.covariance import noise_of_right_side
from driver.dic.interpolation import samples
from driver.dic.kernels import binned
from driver.dic.outcome import explanation
from driver.dic.regularisation import penalties
from driver.dic.surface_images import SurfaceImages, refine_gradient
from driver.dic.system import End, Pixels, System
from driver.images.heightmaps import ImageError
from driver.images.rigid import phase_correlation
from meshes.plane_mesh import PlaneMesh

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

ELEMENT_UV = 16  # px
ELEMENT_W = 8  # px; slip steps and grains make the height vary faster than u, v
ROUGHNESS = 1.0  # px; a jump of 6 % in strain between two elements of 16 px
ROUGHNESS_FIRST = 0.05  # px; nearly affine: no local minimum for the first pass to fall into
JUMP = 0.5  # px; a smaller shift between two frames is left to Gauss–Newton
TOLERANCE = 1e-4  # px; largest nodal update of u, v at convergence
TOLERANCE_FIRST = 2e-2  # px; enough to warp the images back


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
            measured motion has the covariance covariance_one · (δ_tt' + 1/n_reference): all
            share the noise of the reference.
        n_reference: number of images averaged into the reference.
        chi: residual in units of noise, degrees of freedom counted, shape (T,). The relief stands
            for the residual of a frame that is lost.
        lost: whether most of the face left the frame or the iteration diverged, shape (T,).
        iterations: Gauss–Newton steps of the last pass, shape (T,).
        converged: whether the update fell below the tolerance, shape (T,).
        reason: why the iteration of each frame ended, length T.
        roughness: standard deviation granted to second differences of nodal u, v [µm].
        ridge: what was added to the diagonal of the Hessian scaled to unit diagonal;
            0 if it was well conditioned.
    """

    basis_uv: Basis
    basis_w: Basis
    coefficients: FloatArray
    covariance_one: FloatArray
    n_reference: int
    chi: FloatArray
    lost: BoolArray
    iterations: IntArray
    converged: BoolArray
    reason: tuple[str, ...]
    roughness: float
    ridge: float

    def at_pixels(self) -> FloatArray:
        """u, v, w at the pixels of the region of interest [µm], shape (T, n_pix, 3)."""
        return _expand(self.basis_uv, self.basis_w, self.coefficients)


def measure(
    images: SurfaceImages,
    size_uv: float | PlaneMesh | None = None,
    size_w: float | PlaneMesh | None = None,
    roughness: float | None = None,
    workers: int = 1,
) -> SurfaceMotion:
    """Measure u, v, w of every frame against the reference.

    The residual is ρ = f + w − g(x + u, y + v). With ∇f = (∂f/∂x, ∂f/∂y, −1) and the nodal
    functions ψ of all three components, each step solves (M + P) δ = b − P p,

        M_ij = Σ (∇f·ψ_i)(∇f·ψ_j),    b_i = Σ (∇f·ψ_i) ρ,

    factored once for all frames. P = σ²(1 + 1/n) RᵀR/roughness², with R the second
    differences of u and of v over the grid, keeps modes in bounds that a weak pattern leaves
    to the noise. It costs nothing for an affine motion, so a uniform elongation is not biased.

    A height change shorter than about three elements of w does not fit its basis and pulls on
    u, v in proportion to itself, well before χ shows it: choose `size_w` by the topography.

    The first pass starts each frame from the one before it and the rigid shift between the
    two, stiffly, with the gradient of the smoothed reference. The second takes the gradient
    from all images, warped back, and relaxes the penalty to `roughness`.

    Args:
        images: the series.
        size_uv: element size of u and v [µm]; 16 pixels if None; or their mesh.
        size_w: element size of w [µm]; 8 pixels if None; or its mesh.
        roughness: standard deviation granted to second differences of nodal u, v [µm];
            1 pixel if None, infinity for no penalty. On a mesh that is no regular grid the
            equilibrium gap takes the place of the second differences.
        workers: threads over the frames; the result does not depend on it.

    Raises:
        ImageError: the pixels are too few for the nodal values that they are to decide.
    """
    pixel = images.pixel
    basis_uv = _basis(images, size_uv or ELEMENT_UV * pixel)
    basis_w = _basis(images, size_w or ELEMENT_W * pixel)
    refuse_too_fine(len(images.xy), basis_uv, basis_w)
    roughness = ROUGHNESS * pixel if roughness is None else roughness
    starts = _first_pass(images, basis_uv, basis_w, min(roughness, ROUGHNESS_FIRST * pixel))
    images = refine_gradient(images, _expand(basis_uv, basis_w, starts))
    system = _system(images, basis_uv, basis_w, roughness)

    def finish(t: int) -> End:
        return system.iterate(images.frames.coefficients[t], starts[t], TOLERANCE)

    with ThreadPoolExecutor(workers) as pool:
        ends = list(pool.map(finish, range(images.n_frames)))
    coefficients = np.array([end.p for end in ends])
    motion = _expand(basis_uv, basis_w, coefficients)
    noise = noise_of_right_side(
        sensitivity(images.gradient, basis_uv, basis_w),
        images.rows,
        images.cols,
        motion / pixel,
        images.n_reference,
    )
    residuals = np.array([end.residual for end in ends])
    lost = np.array([end.reason in ("left", "diverged") for end in ends])
    residuals[lost] = images.reference - images.reference.mean()
    squares = residuals**2 / images.expected_residual_variance(motion)
    # A pixel that left the image adds nothing, and does not count.
    used = np.isfinite(residuals).sum(axis=1)
    return SurfaceMotion(
        basis_uv=basis_uv,
        basis_w=basis_w,
        coefficients=coefficients,
        covariance_one=images.sigma**2 * system.covariance_of(np.eye(system.size), noise),
        n_reference=images.n_reference,
        chi=np.sqrt(np.nansum(squares, axis=1) / np.maximum(used - system.freedom(), 1.0)),
        lost=lost,
        iterations=np.array([end.iterations for end in ends]),
        converged=np.array([end.reason == "converged" for end in ends]),
        reason=tuple(explanation(end, TOLERANCE) for end in ends),
        roughness=roughness,
        ridge=system.ridge,
    )


def _basis(images: SurfaceImages, size: float | PlaneMesh) -> Basis:
    if isinstance(size, PlaneMesh):
        return mesh_basis(images.xy, size)
    return grid_basis(images.xy, images.bounds, size)


def _system(images: SurfaceImages, basis_uv: Basis, basis_w: Basis, roughness: float) -> System:
    origin = images.frames.origin
    pixels = Pixels(
        rows=images.xy[:, 0] / images.pixel + origin[0],
        cols=images.xy[:, 1] / images.pixel + origin[1],
        height=images.reference,
        slope=np.ascontiguousarray(images.gradient),
        pixel=images.pixel,
    )
    system = System(pixels, basis_uv, basis_w, penalties(basis_uv, basis_w, None)[:1])
    variance = images.sigma**2 * (1.0 + 1.0 / images.n_reference)
    system.weigh([variance / roughness**2])
    return system


def _first_pass(
    images: SurfaceImages, basis_uv: Basis, basis_w: Basis, roughness: float
) -> FloatArray:
    """A stiff motion of every frame, each from where the last good one ended, shape (T, n)."""
    system = _system(images, basis_uv, basis_w, roughness)
    n = 2 * system.n_uv
    box = np.s_[
        images.rows.min() : images.rows.max() + 1, images.cols.min() : images.cols.max() + 1
    ]
    starts = np.zeros((images.n_frames, system.size))
    last, before = starts[0], binned(images.reference_image[box], 2)
    for t, spline in enumerate(images.frames.coefficients):
        after = binned(samples(spline)[box], 2)
        shift = 2 * images.pixel * np.array(phase_correlation(before, after))
        p = last
        if np.hypot(*shift) > JUMP * images.pixel:
            moved = p + np.repeat([*shift, 0.0], [n // 2, n // 2, system.size - n])
            left = [float(np.nanstd(system.residual(spline, q))) for q in (p, moved)]
            p = moved if left[1] < left[0] else p
        end = system.iterate(spline, p, TOLERANCE_FIRST)
        starts[t] = end.p
        # A frame that was not followed would lead astray all that come after it.
        if end.reason == "converged":
            last, before = end.p, after
    return starts


def refuse_too_fine(n_pix: int, basis_uv: Basis, basis_w: Basis) -> None:
    """Refuse elements that are too small for the pixels.

    Raises:
        ImageError: the nodal values are more than half of the pixels.
    """
    unknowns = 2 * len(basis_uv.nodes) + len(basis_w.nodes)
    if 2 * unknowns > n_pix:
        raise ImageError(
            f"dic.element_px: found {unknowns} nodal values to be decided by {n_pix} pixels of the "
            "face, expected at most half as many: larger elements (height_element_px for the "
            "heights), or a face of more pixels (images.pixel_size_nm, origin_pixel, mask)"
        )


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
