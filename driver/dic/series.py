"""Global digital image correlation of a series of height maps."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from driver.common.element_sizes import ELEMENT_UV, ELEMENT_W
from driver.dic.basis import Basis, PixelMotion, basis_on
from driver.dic.engine import CorrelationProblem, KnownNoise, Regularisation, solve
from driver.dic.first_pass import first_pass
from driver.dic.interpolation_noise import mean_autocorrelation, noise_of_right_side
from driver.dic.missing_pixels import Equations
from driver.dic.regularisation import Penalty, penalties
from driver.dic.regularisation_evidence import NoiseAndRoughness, weigh
from driver.dic.relief_gain import Gains
from driver.dic.resolution_check import refuse_too_fine
from driver.dic.surface_images import SurfaceImages, refine_gradient
from driver.dic.system import Pixels, System, sensitivity
from meshes.arrays import BoolArray, FloatArray, IntArray
from meshes.plane_mesh import PlaneMesh

Roughness = float | Literal["estimated"] | None

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
        gains: heights of each frame over those of the reference; the motion is that of a gain of 1.
        iterations: Gauss–Newton steps of the last pass, shape (T,).
        converged: whether the update fell below the tolerance, or within the noise, shape (T,).
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
    gains: Gains
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

    @property
    def fields(self) -> PixelMotion:
        """u, v, w at the pixels of the region of interest, of the frames that are asked for."""
        return PixelMotion(self.basis_uv, self.basis_w, self.coefficients)

    def at_pixels(self) -> FloatArray:
        """u, v, w at the pixels in all frames [µm], shape (T, n_pix, 3)."""
        return self.fields[np.arange(len(self.coefficients))]

    def after_reference(self) -> SurfaceMotion:
        """Return the motion with the reference itself before it, which stands still."""
        n_pix = self.compared.shape[1]
        return replace(
            self,
            coefficients=np.insert(self.coefficients, 0, 0.0, axis=0),
            chi=np.insert(self.chi, 0, 0.0),
            lost=np.insert(self.lost, 0, False),
            gains=replace(self.gains, value=np.insert(self.gains.value, 0, 1.0)),
            iterations=np.insert(self.iterations, 0, 0),
            converged=np.insert(self.converged, 0, True),
            reason=("the reference", *self.reason),
            compared=np.concatenate([np.ones((1, n_pix), dtype=bool), self.compared]),
        )

    def means(self) -> FloatArray:
        """Return the mean of u, v, w over the pixels in each frame [µm], shape (T, 3)."""
        n_uv = len(self.basis_uv.nodes)
        uv, w = (basis.values.mean(axis=0) for basis in (self.basis_uv, self.basis_w))
        parts = np.split(self.coefficients, [n_uv, 2 * n_uv], axis=1)
        return np.column_stack([parts[0] @ uv, parts[1] @ uv, parts[2] @ w])


def measure(
    images: SurfaceImages,
    size_uv: float | PlaneMesh | None = None,
    size_w: float | PlaneMesh | None = None,
    roughness: Roughness = None,
    workers: int = 1,
    penalty: Penalty | None = None,
) -> SurfaceMotion:
    """Measure u, v, w of every frame against the reference; one that is the reference has none.

    `engine.solve` with the gradient of all images, warped back, and no penalty of w. "tikhonov" and
    "equilibrium_gap" cost nothing for an affine motion, so a uniform elongation is not biased.

    A height change shorter than about three elements of w does not fit its basis and pulls on
    u, v in proportion to itself, well before χ shows it: choose `size_w` by the topography.

    The regularisation is ramped down. The first pass starts each frame from the last one that
    was followed and the rigid shift between the two, stiffly, with the gradient of the smoothed
    reference and a penalty that leaves affine motions free. The engine starts from there and
    relaxes to `roughness`, by way of 1 pixel where that is estimated.

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
    if images.of_series:
        alone = images.without_reference()
        later = measure(alone, size_uv, size_w, roughness, workers, penalty)
        return later.after_reference()
    pixel, n_reference = images.pixel, images.n_reference
    basis_uv = basis_on(images.xy, images.bounds, size_uv or ELEMENT_UV * pixel)
    basis_w = basis_on(images.xy, images.bounds, size_w or ELEMENT_W * pixel)
    refuse_too_fine(len(images.xy), len(basis_uv.nodes), len(basis_w.nodes))
    granted = ROUGHNESS * pixel if roughness is None else roughness
    wanted = None if granted == "estimated" else granted
    first = ROUGHNESS_FIRST * pixel
    if isinstance(roughness, float):
        first = min(roughness, first)
    stiff = System(_pixels(images), basis_uv, basis_w, penalties(basis_uv, basis_w, "tikhonov"))
    weigh(stiff, NoiseAndRoughness(images.sigma, first, np.inf), n_reference)
    starts = first_pass(images, stiff)
    images = refine_gradient(images, PixelMotion(basis_uv, basis_w, starts))
    solution = solve(
        CorrelationProblem(
            pixels=_pixels(images),
            basis_uv=basis_uv,
            basis_w=basis_w,
            splines=images.frames.coefficients,
            noise=KnownNoise(n_reference, images.sigma, images.sigma_flat),
        ),
        starts,
        Regularisation(penalty, wanted, np.inf),
        TOLERANCE,
        workers,
        with_residual=False,
    )
    fields = PixelMotion(basis_uv, basis_w, solution.coefficients)
    kept = np.flatnonzero(~solution.unlike)
    shared = mean_autocorrelation(fields[kept[t : t + 1]][0] / pixel for t in range(len(kept)))
    seen = sensitivity(images.gradient, basis_uv, basis_w)
    noise = noise_of_right_side(seen, images.rows, images.cols, shared, n_reference)
    return SurfaceMotion(
        basis_uv=basis_uv,
        basis_w=basis_w,
        coefficients=solution.coefficients,
        covariance_one=solution.covariance_of(np.eye(solution.system.size), noise),
        shared_noise=shared,
        n_reference=n_reference,
        chi=solution.chi,
        lost=solution.lost,
        gains=solution.gains,
        iterations=solution.iterations,
        converged=solution.converged,
        reason=solution.reason,
        roughness=solution.estimate.roughness,
        ridge=solution.system.ridge,
        compared=solution.compared,
        equations=solution.equations,
    )


def _pixels(images: SurfaceImages) -> Pixels:
    origin = images.frames.origin
    return Pixels(
        rows=images.xy[:, 0] / images.pixel + origin[0],
        cols=images.xy[:, 1] / images.pixel + origin[1],
        height=images.reference,
        slope=np.ascontiguousarray(images.gradient),
        pixel=images.pixel,
    )
