"""Correlation of plain arrays: one reference, one or many images, any two meshes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from driver.common.element_sizes import ELEMENT_UV, ELEMENT_W
from driver.common.parallel import blas_on_one_thread
from driver.common.splines.kernels import coefficients, slopes_at
from driver.dic.basis import Basis, basis_on, motion_at_pixels
from driver.dic.engine import (
    CorrelationProblem,
    KnownNoise,
    Regularisation,
    Solution,
    in_threads,
    solve,
)
from driver.dic.missing_pixels import mark_gaps
from driver.dic.pyramid import Starter
from driver.dic.regularisation import Penalty
from driver.dic.system import Pixels
from driver.experiment.images.heightmaps import ImageError, fill_off_surface
from meshes.arrays import BoolArray, FloatArray, IntArray
from meshes.plane_mesh import PlaneMesh

SPREAD = 3  # px around a gap of the reference where its slopes are those of what fills it
LARGEST_DENSE = 5000  # unknowns of a covariance given as one matrix: 200 MB


@dataclass(frozen=True)
class Options:
    """How a correlation is regularised and ended.

    Attributes:
        penalty: what is penalised of u, v: "tikhonov" (second derivatives), "equilibrium_gap"
            (nodal forces inside an elastic sheet) or "elastic" (its energy). None takes the first
            on grids and the second on other meshes.
        roughness: standard deviation granted to what is penalised [px]: inf for no penalty; None
            for the value that makes the images most probable.
        roughness_w: the same for the second differences (or the Laplacian) of w, in the unit of
            the images.
        tolerance: largest nodal update of u, v at convergence [px].
        workers: threads over the images; the result does not depend on it.
    """

    penalty: Penalty | None = None
    roughness: float | None = None
    roughness_w: float | None = None
    tolerance: float = 1e-3
    workers: int = 1

    def __post_init__(self) -> None:
        if self.penalty is not None and self.penalty not in get_args(Penalty):
            known = ", ".join(get_args(Penalty))
            raise ImageError(f"penalty = {self.penalty}; one of {known}, or None, is expected.")
        for name in ("roughness", "roughness_w"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise ImageError(f"{name} = {value}; a positive number, inf or None is expected.")
        if not self.tolerance > 0 or self.workers < 1:
            raise ImageError(
                f"tolerance = {self.tolerance}, workers = {self.workers}; "
                "a positive tolerance and at least 1 worker are expected."
            )


@dataclass(frozen=True, eq=False)
class Correlation(Solution):
    """Measured motion in T images; lengths in the unit of `pixel`, heights in that of the images.

    u runs along the rows' index, v along the columns' index.

    Attributes:
        shape: of an image.
    """

    shape: tuple[int, int]

    @property
    def sigma(self) -> float:
        """Standard deviation of the noise of one image: as given, else as the residual says."""
        return self.estimate.sigma

    @property
    def n_reference(self) -> int:
        """Number of images averaged into the reference."""
        return self.noise.n_reference

    @property
    def roughness(self) -> float:
        """As used [px], see `Options`."""
        return self.estimate.roughness / self.system.pixels.pixel

    @property
    def roughness_w(self) -> float:
        """As used, see `Options`."""
        return self.estimate.roughness_w

    def at_pixels(self, t: int = 0) -> FloatArray:
        """u, v, w of image t at the pixels of the region of interest, shape (n_pix, 3)."""
        p = self.coefficients[t][None]
        return np.asarray(motion_at_pixels(self.basis_uv, self.basis_w, p)[0])

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
            values = values / np.sqrt(self.variance(t))
        picture[at.rows.astype(int), at.cols.astype(int)] = values
        return picture

    def covariance_one(self) -> FloatArray:
        """Return `covariance_of` all nodal values together, shape (n, n).

        Raises:
            ImageError: the matrix would not fit in memory.
        """
        if self.system.size > LARGEST_DENSE:
            raise ImageError(
                f"covariance of {self.system.size} nodal values in one matrix; at most "
                f"{LARGEST_DENSE} are given so: ask covariance_of for the combinations wanted."
            )
        return self.covariance_of(np.eye(self.system.size))


@blas_on_one_thread()
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
    gradient: NDArray[Any] | None = None,
    start: NDArray[Any] | None = None,
) -> Correlation:
    """Find the motion of every image against the reference.

    `engine.solve`, which `series.measure` calls too. A coarse stiff motion, followed from image to
    image through binned copies, gives the starts; where it leaves most of the relief, turns by all
    angles are tried. An image whose heights have another gain is met with it, see `Solution`.

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
        gradient: ∂f/∂X (along the rows' index), ∂f/∂Y where it is better known than from the
            reference alone, whose spline gives it if None, shape (rows, cols, 2).
        start: u, v at the pixels of the reference from which each image is sought, in the unit of
            `pixel`, within some elements; of any shape that spreads over (T, rows, cols, 2), such
            as (2,) for one shift of all images or (T, 1, 1, 2) for one of each. None for the
            motion of the images before.

    Raises:
        ImageError: shapes that differ, nothing left to correlate, or impossible parameters.
    """
    options = options or Options()
    f, stack = checked(reference, images, pixel, sigma, n_reference)
    region = _region(f, mask)
    f = _gapless(f)
    basis_uv, basis_w, rows, cols = _bases(region, pixel, mesh_uv, mesh_w)
    starter = Starter.build(f, region)
    whole = [_gapless(g) for g in stack]
    given = None if start is None else _given(start, (len(whole), *f.shape, 2)) / pixel
    starts = starter.follow(whole, basis_uv.nodes / pixel, basis_w.nodes / pixel, given)
    starts[:, : 2 * len(basis_uv.nodes)] *= pixel
    if gradient is None:
        slope = slopes_at(coefficients(f), rows, cols) / pixel
    else:
        slope = _sloped(gradient, f)[rows, cols]
        if not np.isfinite(slope).all():
            raise ImageError("gradient without a value at pixels to correlate: numbers expected.")
    solution = solve(
        CorrelationProblem(
            pixels=Pixels(rows.astype(float), cols.astype(float), f[rows, cols], slope, pixel),
            basis_uv=basis_uv,
            basis_w=basis_w,
            splines=in_threads(_coefficients, options.workers, whole, stack),
            noise=KnownNoise(n_reference, sigma),
        ),
        starts,
        Regularisation(
            options.penalty,
            None if options.roughness is None else options.roughness * pixel,
            options.roughness_w,
        ),
        options.tolerance,
        options.workers,
        with_gains=True,
    )
    return Correlation(**vars(solution), shape=(f.shape[0], f.shape[1]))


def checked(
    reference: NDArray[Any],
    images: NDArray[Any] | Sequence[NDArray[Any]],
    pixel: float,
    sigma: float | None,
    n_reference: int,
) -> tuple[FloatArray, list[FloatArray]]:
    """Return the heights of the reference and of the images, NaN where there are none.

    Args:
        reference: as of `correlate`.
        images: as of `correlate`.
        pixel: as of `correlate`.
        sigma: as of `correlate`.
        n_reference: as of `correlate`.

    Raises:
        ImageError: shapes that differ, no image, or an impossible pixel or noise.
    """
    f = _heights("reference", reference)
    if f.ndim != 2:
        raise ImageError(f"reference of shape {f.shape}; (rows, cols) is expected.")
    several = [images] if isinstance(images, np.ndarray) and images.ndim == 2 else images
    stack = [_heights(f"image {t}", g) for t, g in enumerate(several)]
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
    if not n_reference >= 1:
        raise ImageError(f"n_reference = {n_reference}; at least 1 image makes the reference.")
    return f, stack


def _heights(name: str, image: NDArray[Any]) -> FloatArray:
    """Return numbers, NaN where a masked array has none."""
    if np.iscomplexobj(image):
        raise ImageError(f"{name} of complex numbers; heights are expected.")
    heights = np.array(image, dtype=np.float64)
    heights[np.ma.getmaskarray(image)] = np.nan
    return heights


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


def region_and_bases(
    f: FloatArray,
    mask: NDArray[Any] | None,
    pixel: float,
    mesh_uv: PlaneMesh | float,
    mesh_w: PlaneMesh | float,
) -> tuple[BoolArray, Basis, Basis]:
    """Return the pixels that `correlate` uses, shape (rows, cols), and its bases at them.

    Args:
        f: reference with its gaps, shape (rows, cols).
        mask: as of `correlate`.
        pixel: as of `correlate`.
        mesh_uv: as of `correlate`.
        mesh_w: as of `correlate`.

    Raises:
        ImageError: nothing is left to correlate.
    """
    basis_uv, basis_w, rows, cols = _bases(_region(f, mask), pixel, mesh_uv, mesh_w)
    used = np.zeros(f.shape, dtype=bool)
    used[rows, cols] = True
    return used, basis_uv, basis_w


def _given(start: NDArray[Any], shape: tuple[int, ...]) -> FloatArray:
    motion = _heights("start", start)
    if not np.isfinite(motion).all():
        raise ImageError("start without a value at some pixels: numbers expected.")
    try:
        return np.broadcast_to(motion, shape)
    except ValueError:
        raise ImageError(
            f"start of shape {motion.shape}; one that spreads over {shape} is expected: u, v of "
            "each image at each pixel."
        ) from None


def _sloped(gradient: NDArray[Any], f: FloatArray) -> FloatArray:
    slope = _heights("gradient", gradient)
    if slope.shape != (*f.shape, 2):
        raise ImageError(
            f"gradient of shape {slope.shape}; {(*f.shape, 2)} is expected: two slopes a pixel."
        )
    return slope


def _gapless(image: FloatArray) -> FloatArray:
    valid = np.isfinite(image)
    return image if valid.all() else fill_off_surface(image, valid)


def _coefficients(whole: FloatArray, image: FloatArray) -> FloatArray:
    """Spline coefficients, NaN where no height was measured."""
    spline: FloatArray = coefficients(whole)
    mark_gaps(spline, image)
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
        basis_on(xy, bounds, mesh if isinstance(mesh, PlaneMesh) else mesh * pixel)
        for mesh in (mesh_uv, mesh_w)
    )
    return uv, w, rows, cols
