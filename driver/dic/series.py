"""Global digital image correlation of a series of height maps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, cho_factor, cho_solve
from scipy.sparse import csr_array, diags_array, hstack

from driver.dic.basis import Basis, grid_basis
from driver.dic.surface_images import SurfaceImages, refine_gradient
from driver.images.rigid import shift_between

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

ELEMENT_UV = 16  # px
ELEMENT_W = 8  # px; slip steps and grains make the height vary faster than u, v
ROUGHNESS = 1.0  # px; a jump of 6 % in strain between two elements of 16 px
ROUGHNESS_FIRST = 0.05  # px; nearly affine: no local minimum for the first pass to fall into
TOLERANCE = 1e-4  # px; largest nodal update of u, v at convergence
TOLERANCE_FIRST = 2e-2  # px; enough to warp the images back
MAX_ITERATIONS = 60
CONDITION = 1e10  # of the Hessian with unit diagonal, beyond which a ridge is added
RIDGE = 1e-8  # of that unit diagonal
CONVERGED = f"update of u, v below {TOLERANCE:g} px"
STOPPED = f"no convergence in {MAX_ITERATIONS} steps"


@dataclass(frozen=True, eq=False)
class SurfaceMotion:
    """Measured motion of the surface in T frames.

    Attributes:
        basis_uv: basis of u and of v, n_uv functions.
        basis_w: basis of w, n_w functions.
        coefficients: nodal values [µm], ordered [u | v | w], shape (T, n), n = 2 n_uv + n_w.
        covariance_one: covariance that the noise of one frame causes [µm²], shape (n, n):
            σ² M⁻¹, or σ² A⁻¹ M A⁻¹ with the penalty, A = M + P. Between the frames t and t'
            the measured motion has the covariance covariance_one · (δ_tt' + 1/n_reference):
            all share the noise of the reference.
        n_reference: number of images averaged into the reference.
        chi: residual in units of noise, degrees of freedom counted, shape (T,).
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
    size_uv: float | None = None,
    size_w: float | None = None,
    roughness: float | None = None,
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
        size_uv: element size of u and v [µm]; 16 pixels if None.
        size_w: element size of w [µm]; 8 pixels if None.
        roughness: standard deviation granted to second differences of nodal u, v [µm];
            1 pixel if None, infinity for no penalty.
    """
    pixel = images.pixel
    basis_uv = grid_basis(images.xy, images.bounds, size_uv or ELEMENT_UV * pixel)
    basis_w = grid_basis(images.xy, images.bounds, size_w or ELEMENT_W * pixel)
    roughness = ROUGHNESS * pixel if roughness is None else roughness
    first = _System.build(images, basis_uv, basis_w, min(roughness, ROUGHNESS_FIRST * pixel))
    first_pass = np.zeros((images.n_frames, first.jacobian.shape[1]))
    p, still = first_pass[0], images.reference_image
    for t, image in enumerate(_stills(images)):
        start = p + _rigid_start(still, image, images, basis_uv, basis_w)
        p, still = first.solve(images, start, t, TOLERANCE_FIRST)[0], image
        first_pass[t] = p

    images = refine_gradient(images, _expand(basis_uv, basis_w, first_pass))
    second = _System.build(images, basis_uv, basis_w, roughness)
    ends = [second.solve(images, start, t, TOLERANCE) for t, start in enumerate(first_pass)]
    coefficients = np.array([end[0] for end in ends])
    converged = np.array([end[2] for end in ends])
    response = second.response()
    motion = _expand(basis_uv, basis_w, coefficients)
    return SurfaceMotion(
        basis_uv=basis_uv,
        basis_w=basis_w,
        coefficients=coefficients,
        covariance_one=images.sigma**2 * response @ second.hessian @ response,
        n_reference=images.n_reference,
        chi=images.chi(motion, float(np.sum(response * second.hessian))),
        iterations=np.array([end[1] for end in ends]),
        converged=converged,
        reason=tuple(CONVERGED if done else STOPPED for done in converged),
        roughness=roughness,
        ridge=second.ridge,
    )


@dataclass(frozen=True, eq=False)
class _System:
    """Jacobian ∇f·ψ (n_pix, n), Hessian M, penalty P (both n, n), and the factored M + P."""

    basis_uv: Basis
    basis_w: Basis
    jacobian: csr_array
    hessian: FloatArray
    penalty: FloatArray
    factor: tuple[FloatArray, bool]
    ridge: float

    @staticmethod
    def build(images: SurfaceImages, basis_uv: Basis, basis_w: Basis, roughness: float) -> _System:
        jacobian = sensitivity(images.gradient, basis_uv, basis_w)
        hessian = (jacobian.T @ jacobian).toarray()
        variance = images.sigma**2 * (1.0 + 1.0 / images.n_reference)
        rough = variance / roughness**2 * _second_differences(basis_uv)
        penalty = block_diag(rough, rough, np.zeros((basis_w.nodes.shape[0],) * 2))
        total = hessian + penalty
        diagonal = total.diagonal()
        scale = np.sqrt(np.where(diagonal > 0, diagonal, diagonal.max()))
        ridge = RIDGE if np.linalg.cond(total / np.outer(scale, scale)) > CONDITION else 0.0
        factor = cho_factor(total + ridge * np.diag(scale**2))
        return _System(basis_uv, basis_w, jacobian, hessian, penalty, factor, ridge)

    def response(self) -> FloatArray:
        """(M + P)⁻¹, shape (n, n)."""
        return np.asarray(cho_solve(self.factor, np.eye(len(self.hessian))))

    def solve(
        self, images: SurfaceImages, start: FloatArray, t: int, tolerance: float
    ) -> tuple[FloatArray, int, bool]:
        p, n_moving = start, 2 * len(self.basis_uv.nodes)
        step, largest_before = 1.0, np.inf
        for iteration in range(1, MAX_ITERATIONS + 1):
            motion = _expand(self.basis_uv, self.basis_w, p[None])
            residual = images.residual(motion, np.array([t]))[0]
            update = cho_solve(self.factor, self.jacobian.T @ residual - self.penalty @ p)
            largest = float(np.abs(update[:n_moving]).max())
            # M is that of the reference: where the frame is steeper, full steps overshoot.
            if largest > 0.9 * largest_before:
                step = max(0.5 * step, 0.2)
            p, largest_before = p + step * update, largest
            if largest < tolerance * images.pixel:
                return p, iteration, True
        return p, MAX_ITERATIONS, False


def sensitivity(gradient: FloatArray, basis_uv: Basis, basis_w: Basis) -> csr_array:
    """∇f·ψ of every function of [u | v | w], shape (n_pix, n); M is its Gram matrix.

    Args:
        gradient: ∂f/∂X, ∂f/∂Y [-], shape (n_pix, 2).
        basis_uv: basis of u and of v.
        basis_w: basis of w.
    """
    along_x, along_y = (diags_array(slope) @ basis_uv.values for slope in gradient.T)
    return csr_array(hstack([along_x, along_y, -basis_w.values]))


def _second_differences(basis: Basis) -> FloatArray:
    """RᵀR for the second differences ∂XX, ∂YY and ∂XY of nodal values, in nodal units."""
    eye_x, eye_y = (np.eye(n + 1) for n in basis.cells)
    bends = (
        np.kron(np.diff(eye_x, 2, axis=0), eye_y),
        np.kron(eye_x, np.diff(eye_y, 2, axis=0)),
        np.kron(np.diff(eye_x, axis=0), np.diff(eye_y, axis=0)),
    )
    return np.asarray(sum(bend.T @ bend for bend in bends))


def _expand(basis_uv: Basis, basis_w: Basis, p: FloatArray) -> FloatArray:
    n = basis_uv.values.shape[1]
    parts = ((basis_uv, p[:, :n]), (basis_uv, p[:, n : 2 * n]), (basis_w, p[:, 2 * n :]))
    return np.stack([(basis.values @ q.T).T for basis, q in parts], axis=-1)


def _stills(images: SurfaceImages) -> list[FloatArray]:
    """The frames as sampled, from their spline coefficients."""
    rows, cols = np.indices(images.shape, dtype=np.float64)
    x, y = ((r - o) * images.pixel for r, o in zip((rows, cols), images.frames.origin, strict=True))
    return [images.frames.value(t, x, y) for t in range(images.n_frames)]


def _rigid_start(
    before: FloatArray, after: FloatArray, images: SurfaceImages, basis_uv: Basis, basis_w: Basis
) -> FloatArray:
    mask = np.zeros(images.shape, dtype=bool)
    mask[images.rows, images.cols] = True
    shift = shift_between(before, after, images.pixel, mask)
    n, n_w = basis_uv.values.shape[1], basis_w.values.shape[1]
    return np.repeat(np.array(shift), [n, n, n_w])
