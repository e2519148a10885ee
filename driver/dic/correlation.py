"""Correlation of plain arrays: one reference, one or many images, any two meshes."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from driver.common.splines.kernels import coefficients, slopes_at
from driver.dic.basis import Basis, grid_basis, mesh_basis
from driver.dic.messages import explanation
from driver.dic.pyramid import Starter
from driver.dic.search import Options, Search, expected_variance, motion_at_pixels
from driver.dic.system import Pixels, System
from driver.experiment.images.heightmaps import ImageError, fill_off_surface
from meshes.plane_mesh import PlaneMesh

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

ELEMENT_UV, ELEMENT_W = 16.0, 8.0  # px
SPREAD = 3  # px around a pixel without height that its spline coefficients carry it to
LARGEST_DENSE = 5000  # unknowns of a covariance given as one matrix: 200 MB


@dataclass(frozen=True, eq=False)
class Correlation:
    """Measured motion in T images; lengths in the unit of `pixel`, heights in that of the images.

    Attributes:
        system: bases, Hessian, penalty and factor of the last iterations.
        coefficients: nodal values [u | v | w], shape (T, n); u along the rows' index, v along the
            columns' index.
        residual: ρ = f + w − g(x + u, y + v) at each pixel, NaN where not compared, (T, n_pix).
        sigma: standard deviation of the noise of one image at a pixel: as given, else estimated
            from the residual.
        n_reference: number of images averaged into the reference.
        roughness, roughness_w: as used, see `Options`.
        iterations: Gauss–Newton steps of the last system, (T,).
        converged: whether the update fell below the tolerance, (T,).
        reason: why each image's iteration ended, and what to try if it failed, length T.
        shape: of an image.
    """

    system: System
    coefficients: FloatArray
    residual: FloatArray
    sigma: float
    n_reference: int
    roughness: float
    roughness_w: float
    iterations: IntArray
    converged: BoolArray
    reason: tuple[str, ...]
    shape: tuple[int, int]

    @property
    def basis_uv(self) -> Basis:
        """Basis of u and of v."""
        return self.system.basis_uv

    @property
    def basis_w(self) -> Basis:
        """Basis of w."""
        return self.system.basis_w

    def at_pixels(self, t: int = 0) -> FloatArray:
        """u, v, w of image t at the pixels of the region of interest, shape (n_pix, 3)."""
        return motion_at_pixels(self.system, self.coefficients[t])

    def residual_map(self, t: int = 0, in_sigma: bool = False) -> FloatArray:
        """ρ of image t over the image, NaN where not compared, shape (rows, cols).

        Args:
            t: image.
            in_sigma: divide by the standard deviation that noise alone would give each pixel.
        """
        at = self.system.pixels
        picture = np.full(self.shape, np.nan)
        values = self.residual[t]
        if in_sigma:
            values = values / np.sqrt(self._variance(t))
        picture[at.rows.astype(int), at.cols.astype(int)] = values
        return picture

    @property
    def chi(self) -> FloatArray:
        """Residual of each image in units of noise; 1 if only noise is left, shape (T,)."""
        freedom = self.system.freedom()
        squares = [self.residual[t] ** 2 / self._variance(t) for t in range(len(self.residual))]
        used = np.isfinite(self.residual).sum(axis=1)
        return np.asarray(np.sqrt(np.nansum(squares, axis=1) / (used - freedom)))

    def covariance_of(self, functionals: FloatArray) -> FloatArray:
        """Covariance that the noise of one image causes in linear functionals of [u | v | w].

        σ² L A⁻¹ M A⁻¹ Lᵀ with A = M + P. Between the images t and t' it is to be multiplied by
        δ_tt' + 1/n_reference. A penalty takes noise away and adds a bias, which is not in it.
        Between the pixels interpolation smoothes the noise of an image, but its slopes as much.

        Args:
            functionals: L, shape (m, n).
        """
        return self.sigma**2 * self.system.covariance_of(functionals, self.system.hessian)

    def covariance_one(self) -> FloatArray:
        """Return the same of all nodal values together, shape (n, n).

        Raises:
            ImageError: the matrix would not fit in memory.
        """
        if self.system.size > LARGEST_DENSE:
            raise ImageError(
                f"covariance of {self.system.size} nodal values in one matrix; at most "
                f"{LARGEST_DENSE} are given so: ask covariance_of for the combinations wanted."
            )
        return self.covariance_of(np.eye(self.system.size))

    def _variance(self, t: int) -> FloatArray:
        gain = expected_variance(self.system, self.coefficients[t], self.n_reference)
        return self.sigma**2 * gain


def correlate(
    reference: NDArray[Any],
    images: NDArray[Any] | Sequence[NDArray[Any]],
    pixel: float = 1.0,
    mask: NDArray[Any] | None = None,
    mesh_uv: PlaneMesh | float = ELEMENT_UV,
    mesh_w: PlaneMesh | float = ELEMENT_W,
    sigma: float | None = None,
    n_reference: int = 1,
    options: Options | None = None,
) -> Correlation:
    """Find the motion of every image against the reference.

    As in `series.measure`, with M of the gradient of the reference, factored once for all images.
    A coarse stiff motion, followed from image to image through binned copies, gives the starts.

    Args:
        reference: heights f, NaN where none was measured, shape (rows, cols).
        images: heights g of one image, or of T images of the same shape. Never normalised.
        pixel: size of a pixel.
        mask: pixels of the reference to use; all if None.
        mesh_uv: mesh of u, v, in the unit of `pixel` with the first pixel at the origin and X
            along the rows' index; or the size of the elements of a regular grid [px]. Pixels
            outside a mesh are not used.
        mesh_w: the same for w.
        sigma: noise of one image at a pixel; estimated from the residual if None.
        n_reference: number of images averaged into the reference.
        options: regularisation and ending.

    Raises:
        ImageError: shapes that differ, nothing left to correlate, or impossible parameters.
    """
    options = options or Options()
    f, stack = _checked(reference, images, pixel, sigma, n_reference)
    region = _region(f, mask)
    f = _gapless(f)
    basis_uv, basis_w, rows, cols = _bases(region, pixel, mesh_uv, mesh_w)
    starter = Starter.build(f, region)
    slope = slopes_at(coefficients(f), rows, cols) / pixel
    pixels = Pixels(rows.astype(float), cols.astype(float), f[rows, cols], slope, pixel)
    whole = [_gapless(g) for g in stack]
    starts = starter.follow(whole, basis_uv.nodes / pixel, basis_w.nodes / pixel)
    n_uv = len(basis_uv.nodes)
    for start in starts:
        start[: 2 * n_uv] *= pixel
    with ExitStack() as closing:
        pool = None
        if min(options.workers, len(stack)) > 1:
            pool = closing.enter_context(ThreadPoolExecutor(options.workers))
        splines = list((pool.map if pool else map)(_coefficients, whole, stack))
        search = Search(pixels, basis_uv, basis_w, options, sigma, n_reference, splines, pool)
        system, ends, estimate = search.run(starts)
    return Correlation(
        system=system,
        coefficients=np.array([end.p for end in ends]),
        residual=np.array([end.residual for end in ends]),
        sigma=estimate.sigma,
        n_reference=n_reference,
        roughness=estimate.roughness / pixel,
        roughness_w=estimate.roughness_w,
        iterations=np.array([end.iterations for end in ends]),
        converged=np.array([end.reason == "converged" for end in ends]),
        reason=tuple(explanation(end, options.tolerance) for end in ends),
        shape=(f.shape[0], f.shape[1]),
    )


def _checked(
    reference: NDArray[Any],
    images: NDArray[Any] | Sequence[NDArray[Any]],
    pixel: float,
    sigma: float | None,
    n_reference: int,
) -> tuple[FloatArray, list[FloatArray]]:
    f = np.asarray(reference, dtype=np.float64)
    if f.ndim != 2:
        raise ImageError(f"reference of shape {f.shape}; (rows, cols) is expected.")
    several = [images] if isinstance(images, np.ndarray) and images.ndim == 2 else images
    stack = [np.asarray(g, dtype=np.float64) for g in several]
    for t, g in enumerate(stack):
        if g.shape != f.shape:
            raise ImageError(f"image {t} of {g.shape} px, but the reference has {f.shape} px.")
        if not np.isfinite(g).any():
            raise ImageError(f"image {t}: no pixel carries a height.")
    if not stack:
        raise ImageError("no image to correlate: the stack is empty.")
    if not (np.isfinite(pixel) and pixel > 0):
        raise ImageError(f"pixel = {pixel}; a positive size is expected.")
    if sigma is not None and not (np.isfinite(sigma) and sigma > 0):
        raise ImageError(f"sigma = {sigma}; a positive height noise, or None, is expected.")
    if n_reference < 1:
        raise ImageError(f"n_reference = {n_reference}; at least 1 image makes the reference.")
    return f, stack


def _region(f: FloatArray, mask: NDArray[Any] | None) -> BoolArray:
    """Pixels to correlate: of the mask, and away from gaps in the reference."""
    region = np.isfinite(f)
    if not region.all():
        region = ndimage.binary_erosion(region, iterations=SPREAD, border_value=1)
    if mask is not None:
        chosen = np.asarray(mask, dtype=bool)
        if chosen.shape != f.shape:
            raise ImageError(f"mask of {chosen.shape} px, but the reference has {f.shape} px.")
        region &= chosen
    if not region.any():
        raise ImageError("no pixel to correlate: the mask is empty or the reference has no height.")
    if np.ptp(f[region]) == 0:
        raise ImageError("the reference has no relief inside the mask: motion cannot be seen.")
    return np.asarray(region)


def _gapless(image: FloatArray) -> FloatArray:
    valid = np.isfinite(image)
    return image if valid.all() else fill_off_surface(image, valid)


def _coefficients(whole: FloatArray, image: FloatArray) -> FloatArray:
    """Spline coefficients, NaN where they carry heights that were not measured."""
    spline: FloatArray = coefficients(whole)
    missing = ~np.isfinite(image)
    if missing.any():
        spline[ndimage.binary_dilation(missing, iterations=SPREAD)] = np.nan
    return spline


def _bases(
    region: BoolArray, pixel: float, mesh_uv: PlaneMesh | float, mesh_w: PlaneMesh | float
) -> tuple[Basis, Basis, IntArray, IntArray]:
    """Both bases at the pixels that they share, and the rows and columns of these."""
    rows, cols = np.nonzero(region)
    xy = np.column_stack([rows, cols]) * np.float64(pixel)
    meshes = [mesh for mesh in (mesh_uv, mesh_w) if isinstance(mesh, PlaneMesh)]
    for size in (mesh_uv, mesh_w):
        if not isinstance(size, PlaneMesh) and not size > 0:
            raise ImageError(f"element of {size} px; a positive size or a mesh is expected.")
    if meshes:
        inside = np.all([mesh.locate(xy)[0] >= 0 for mesh in meshes], axis=0)
        if not inside.any():
            (x0, y0), (x1, y1) = xy.min(axis=0), xy.max(axis=0)
            raise ImageError(
                f"no pixel lies in the mesh; those to correlate reach over X {x0:.4g} to {x1:.4g}, "
                f"Y {y0:.4g} to {y1:.4g}."
            )
        rows, cols, xy = rows[inside], cols[inside], xy[inside]
    low = np.array([rows.min(), cols.min()]) * pixel
    # One row of pixels still spans a grid.
    high = np.maximum(np.array([rows.max(), cols.max()]) * pixel, low + pixel)
    bounds = (float(low[0]), float(high[0]), float(low[1]), float(high[1]))
    uv, w = (
        mesh_basis(xy, mesh)
        if isinstance(mesh, PlaneMesh)
        else grid_basis(xy, bounds, mesh * pixel)
        for mesh in (mesh_uv, mesh_w)
    )
    return uv, w, rows, cols
