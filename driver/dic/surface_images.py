"""The images of one series as digital image correlation needs them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.stats import chi2

from driver.dic.interpolation import SplineImages, spline_images, variance_gain
from driver.images.flatfield import FlatField
from driver.images.heightmaps import ImageError, fill_off_surface, on_surface
from driver.images.noise import noise_from_repeats
from driver.images.rigid import Shift, shift_between

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

SMOOTHING = 1.0  # px; of the first gradient, whose noise would otherwise rival the pattern
WALL = 2.0  # px; pixels as near to a trench wall interpolate heights that were not measured
RING = 4  # px around the region of interest that the derivative of a cubic spline still feels
SIGNIFICANCE = 1e-3  # chance of registering repeats that did not move


@dataclass(frozen=True, eq=False)
class SurfaceImages:
    """Reference, frames and noise over a region of interest of n_pix pixels.

    Attributes:
        xy: X, Y of the pixels in the reference [µm], shape (n_pix, 2).
        rows: row of each pixel, shape (n_pix,).
        cols: column of each pixel, shape (n_pix,).
        reference: height f of each pixel, mean of the repeats [µm], shape (n_pix,).
        gradient: ∂f/∂X, ∂f/∂Y at each pixel [-], shape (n_pix, 2).
        frames: the T images of the series.
        sigma: standard deviation of the noise of one frame at a pixel [µm].
        n_reference: number of images averaged into `reference`.
        shape: (rows, cols) of an image.
        pixel: size of a pixel [µm].
        bounds: rectangle (x0, x1, y0, y1) that was asked for [µm].
        reference_image: the whole reference [µm], extended over trenches, shape (rows, cols).
    """

    xy: FloatArray
    rows: IntArray
    cols: IntArray
    reference: FloatArray
    gradient: FloatArray
    frames: SplineImages
    sigma: float
    n_reference: int
    shape: tuple[int, int]
    pixel: float
    bounds: tuple[float, float, float, float]
    reference_image: FloatArray

    @property
    def n_frames(self) -> int:
        """Number T of images in the series."""
        return len(self.frames.coefficients)

    def residual(self, motion: FloatArray, index: IntArray | None = None) -> FloatArray:
        """ρ = f(x) + w − g(x + u, y + v) [µm].

        Args:
            motion: u, v, w along X, Y, Z at each pixel [µm], shape (T, n_pix, 3).
            index: the frames that the motion belongs to, shape (T,); all if None.

        Returns:
            Shape (T, n_pix).
        """
        index = np.arange(self.n_frames) if index is None else index
        moved = self.xy + motion[..., :2]
        return (
            self.reference + motion[..., 2] - self.frames.value(index, moved[..., 0], moved[..., 1])
        )

    def expected_residual_variance(self, motion: FloatArray) -> FloatArray:
        """Variance of ρ from noise alone [µm²], shape (T, n_pix).

        σ² (gain + 1/n): interpolation between pixels lowers the noise of a frame by a known
        gain, and the reference adds that of its mean of n images.
        """
        moved = (self.xy + motion[..., :2]) / self.pixel + self.frames.origin
        return self.sigma**2 * (variance_gain(moved[..., 0], moved[..., 1]) + 1 / self.n_reference)

    def chi(
        self, motion: FloatArray, n_parameters: float = 0.0, index: IntArray | None = None
    ) -> FloatArray:
        """Residual of each frame in units of noise; 1 if only noise is left.

        χ² = Σ ρ²/E[ρ²] / (n_pix − n_parameters).

        Args:
            motion: as in `residual`.
            n_parameters: degrees of freedom of the motion that were fitted to each frame.
            index: as in `residual`.

        Returns:
            Shape (T,).
        """
        squares = self.residual(motion, index) ** 2 / self.expected_residual_variance(motion)
        return np.asarray(np.sqrt(squares.sum(axis=1) / (len(self.xy) - n_parameters)))


def prepare(
    frames: FloatArray,
    repeats: FloatArray,
    flat: FlatField | None,
    pixel: float,
    origin: tuple[float, float],
    bounds: tuple[float, float, float, float],
    mask: BoolArray | None = None,
) -> SurfaceImages:
    """Correct the images and gather what correlation needs.

    The flat pattern is subtracted; repeats that moved significantly are registered to the
    first one; pixels without a height (not finite, or at level 0) are filled from their
    neighbours and, with a margin, kept out of the region of interest.

    Args:
        frames: height maps of the series [µm], shape (T, rows, cols).
        repeats: height maps of the unloaded surface [µm], shape (n, rows, cols).
        flat: fixed pattern to subtract, if known.
        pixel: size of a pixel [µm].
        origin: (row, column) of X = 0, Y = 0 in the repeats.
        bounds: rectangle (x0, x1, y0, y1) of the region of interest [µm].
        mask: pixels that may be used, shape (rows, cols); all if None.

    Raises:
        ImageError: sizes that differ, a frame without heights, or an empty region of interest.
    """
    shape = repeats.shape[1:]
    for name, found in (
        ("frames", frames.shape[1:]),
        ("flat pattern", shape if flat is None else flat.pattern.shape),
        ("mask", shape if mask is None else mask.shape),
    ):
        if found != shape:
            raise ImageError(f"{name} of {found} px, but the repeats have {shape} px.")
    pattern = np.zeros(shape) if flat is None else flat.pattern
    valid = np.asarray(on_surface(repeats).all(axis=0))
    region = _region(valid, pixel, origin, bounds, mask)
    rows, cols = np.nonzero(region)
    repeats = _corrected(repeats, pattern, "repeat")
    repeats, sigma = _registered(repeats, region, pixel)
    reference = np.asarray(repeats.mean(axis=0))
    smooth = ndimage.gaussian_filter(reference, SMOOTHING)
    xy = np.column_stack([(rows - origin[0]) * pixel, (cols - origin[1]) * pixel])
    return SurfaceImages(
        xy=xy,
        rows=rows,
        cols=cols,
        reference=reference[rows, cols],
        gradient=spline_images(smooth[None], pixel, origin).gradient(0, xy[:, 0], xy[:, 1]),
        frames=spline_images(_corrected(frames, pattern, "frame"), pixel, origin),
        sigma=sigma,
        n_reference=len(repeats),
        shape=(shape[0], shape[1]),
        pixel=pixel,
        bounds=bounds,
        reference_image=reference,
    )


def refine_gradient(images: SurfaceImages, motion: FloatArray) -> SurfaceImages:
    """Take the gradient from the mean of the repeats and of all frames, warped back.

    The mean of n + T images has little noise of its own to be mistaken for pattern. A frame
    counts by 1/χ², so that one with an artefact does not spoil it. The reference values stay
    those of the repeats alone: later statistics need to know whose noise they carry.

    Args:
        images: the series.
        motion: motion of every frame from a first correlation [µm], shape (T, n_pix, 3).
    """
    roi = np.zeros(images.shape, dtype=bool)
    roi[images.rows, images.cols] = True
    ring = ndimage.binary_dilation(roi, iterations=RING)
    rows, cols = np.nonzero(ring)
    pixel_of = np.zeros(images.shape, dtype=np.int64)
    pixel_of[images.rows, images.cols] = np.arange(len(images.rows))
    nearest = ndimage.distance_transform_edt(~roi, return_distances=False, return_indices=True)
    carried = motion[:, pixel_of[tuple(nearest)][rows, cols]]
    moved = (np.column_stack([rows, cols]) - images.frames.origin) * images.pixel + carried[..., :2]
    weights = np.minimum(1.0, images.chi(motion) ** -2.0)
    total = images.n_reference * images.reference_image[rows, cols]
    for t, weight in enumerate(weights):
        warped = images.frames.value(t, moved[t, :, 0], moved[t, :, 1]) - carried[t, :, 2]
        total = total + weight * warped
    mean = images.reference_image.copy()
    mean[rows, cols] = total / (images.n_reference + weights.sum())
    spline = spline_images(mean[None], images.pixel, images.frames.origin)
    return replace(images, gradient=spline.gradient(0, images.xy[:, 0], images.xy[:, 1]))


def _region(
    valid: BoolArray,
    pixel: float,
    origin: tuple[float, float],
    bounds: tuple[float, float, float, float],
    mask: BoolArray | None,
) -> BoolArray:
    x = (np.arange(valid.shape[0]) - origin[0]) * pixel
    y = (np.arange(valid.shape[1]) - origin[1]) * pixel
    x0, x1, y0, y1 = bounds
    region = np.outer((x >= x0) & (x <= x1), (y >= y0) & (y <= y1))
    if not valid.all():
        region &= ndimage.distance_transform_edt(valid) > WALL
    if mask is not None:
        region &= mask
    if not region.any():
        raise ImageError(
            f"no pixel of the images lies inside the bounds {bounds} µm, on the surface and in "
            f"the mask; the field of view is X {x[0]:.3g} to {x[-1]:.3g}, "
            f"Y {y[0]:.3g} to {y[-1]:.3g} µm."
        )
    return region


def _corrected(stack: FloatArray, pattern: FloatArray, name: str) -> FloatArray:
    corrected = np.empty_like(stack)
    for t, heights in enumerate(stack):
        valid = on_surface(heights)
        if not valid.any():
            raise ImageError(f"{name} {t}: no pixel carries a height (all empty or at level 0).")
        corrected[t] = fill_off_surface(heights - pattern, valid)
    return corrected


def _registered(repeats: FloatArray, region: BoolArray, pixel: float) -> tuple[FloatArray, float]:
    """Repeats brought onto the first one if they moved, and the noise of one frame [µm]."""
    sigma = noise_from_repeats(repeats, region).sigma
    shifts = np.array([shift_between(repeats[0], r, pixel, region) for r in repeats[1:]])
    smooth = ndimage.gaussian_filter(repeats.mean(axis=0), SMOOTHING)
    slopes = np.column_stack([g[region] for g in np.gradient(smooth, pixel)])
    slopes -= slopes.mean(axis=0)
    # Shifts against a common first repeat share its noise: covariance σ² M⁻¹ (I + 1 1ᵀ).
    centred = shifts[:, :2] - shifts[:, :2].sum(axis=0) / len(repeats)
    own = np.vstack([-shifts[:, :2].sum(axis=0) / len(repeats), centred])
    statistic = np.einsum("ti,ij,tj->", own, slopes.T @ slopes, own) / sigma**2
    if statistic < chi2.isf(SIGNIFICANCE, 2 * (len(repeats) - 1)):
        return repeats, sigma
    registered, gains = [repeats[0]], [1.0]
    grid = np.indices(region.shape, dtype=np.float64)
    for heights, shift in zip(repeats[1:], map(Shift._make, shifts), strict=True):
        step = np.array([shift.dx, shift.dy]) / pixel
        moved = ndimage.map_coordinates(heights, grid + step[:, None, None], mode="mirror")
        registered.append(moved - shift.dz)
        gains.append(float(variance_gain(step[0], step[1])))
    scatter = noise_from_repeats(np.array(registered), region).sigma
    return np.array(registered), scatter / float(np.sqrt(np.mean(gains)))
