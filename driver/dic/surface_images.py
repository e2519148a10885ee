"""The images of one series as digital image correlation needs them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from scipy import ndimage

from driver.common.splines.images import SplineImages, samples, spline_images
from driver.common.splines.kernels import coefficients
from driver.dic.missing_pixels import mark_gaps
from driver.dic.residual_noise import residual_chi, residual_variance
from driver.experiment.images.flatfield import FlatField, without_noise
from driver.experiment.images.heightmaps import (
    HeightMaps,
    ImageError,
    fill_off_surface,
    on_surface,
)
from driver.experiment.images.reference import (
    Reference,
    build_reference,
    corrected,
    stated_reference,
)
from driver.experiment.images.region import Bounds, CodeArray
from driver.experiment.images.repeat_stretch import RepeatStretch
from meshes.arrays import BoolArray, FloatArray, IntArray

SMOOTHING = 1.0  # px; of the first gradient, whose noise would otherwise rival the pattern
RING = 4  # px around the region of interest that the derivative of a cubic spline still feels
_BLOCK = 2**18  # pixels of the images that are at work together, at least one image
_KEPT = 2**22  # pixels of a series whose splines are kept in memory


class PixelFields(Protocol):
    """Motion u, v, w at the pixels by frame [µm]; an array of shape (T, n_pix, 3) is such."""

    def __getitem__(self, index: IntArray, /) -> FloatArray:
        """Motion of some frames, shape (len(index), n_pix, 3)."""


@dataclass(frozen=True, eq=False)
class Rescaling:
    """Frames that show the relief higher or lower than the reference does, brought to its height.

    The noise of a frame is divided with its heights: it is that of the others where their scale
    has changed, and not where focus did the same.

    Attributes:
        gains: heights of each frame over those of the reference, shape (T,).
        rows, cols: pixels over which the mean height of a frame stays, shape (n_pix,) each.
    """

    gains: FloatArray
    rows: IntArray
    cols: IntArray

    def of(self, t: int, spline: FloatArray) -> FloatArray:
        """Return coefficients of frame t [µm], as they are where its gain is 1."""
        gain = float(self.gains[t])
        if gain == 1.0:
            return spline
        level = float(np.nanmean(spline[self.rows, self.cols]))
        return (spline - level) / gain + level


@dataclass(frozen=True, eq=False)
class FrameSplines:
    """Spline coefficients of corrected frames, made anew whenever one is asked for.

    The frames of a long series do not fit into memory as numbers.

    Attributes:
        frames: height maps of the series [µm].
        flat: fixed pattern to subtract, if known.
        first: number of the first frame that is asked for.
        rescaling: of all frames, None without.
    """

    frames: HeightMaps
    flat: FlatField | None
    first: int = 0
    rescaling: Rescaling | None = None

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.frames) - self.first

    def __getitem__(self, index: int, /) -> FloatArray:
        """Coefficients [µm], NaN where no height was measured, shape (rows, cols)."""
        number = self.first + index
        heights = self.frames[number]
        spline: FloatArray = coefficients(corrected(heights, self.flat, f"frame {number}"))
        mark_gaps(spline, heights)
        return spline if self.rescaling is None else self.rescaling.of(number, spline)


@dataclass(frozen=True, eq=False)
class SurfaceImages:
    """Reference, frames and noise over a region of interest of n_pix pixels.

    Attributes:
        xy: X, Y of the pixels in the reference [µm], shape (n_pix, 2).
        rows: row of each pixel, shape (n_pix,).
        cols: column of each pixel, shape (n_pix,).
        reference: height f of each pixel, mean of the repeats or that of frame 0 [µm],
            shape (n_pix,).
        gradient: ∂f/∂X, ∂f/∂Y at each pixel [-], shape (n_pix, 2).
        frames: the T images of the series, their coefficients NaN where no height was measured;
            of a long series they are made anew whenever they are asked for, see `blocks`.
        sigma: standard deviation of the noise of one frame at a pixel [µm].
        n_reference: number of images averaged into `reference`.
        shape: (rows, cols) of an image.
        pixel: size of a pixel [µm].
        bounds: rectangle (x0, x1, y0, y1) that was asked for [µm].
        reference_image: the whole reference [µm], extended over trenches, shape (rows, cols).
        noise_dof: degrees of freedom behind `sigma`, 0 where it is stated.
        sigma_flat: standard error of the flat pattern that was subtracted [µm].
        flat_error: the same at each pixel [µm], shape (rows, cols).
        flat_pattern: that pattern without its noise [µm], shape (rows, cols), None without flats.
        flat_noise: its noise, which by subtraction is in every image [µm], shape (rows, cols).
        codes: what becomes of each pixel, values of `Excluded`, shape (rows, cols).
        of_series: whether the reference is frame 0 of the series, for want of repeats: that frame
            says nothing of itself.
        repeat_stretch: strain between the repeats, None without.
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
    noise_dof: int
    sigma_flat: float
    flat_error: FloatArray
    flat_pattern: FloatArray | None
    flat_noise: FloatArray
    codes: CodeArray
    of_series: bool = False
    repeat_stretch: RepeatStretch | None = None

    @property
    def n_frames(self) -> int:
        """Number T of images in the series."""
        return len(self.frames.coefficients)

    @property
    def is_reference(self) -> BoolArray:
        """Frames that are the reference, shape (T,)."""
        return np.asarray((np.arange(self.n_frames) == 0) & self.of_series)

    def without_reference(self) -> SurfaceImages:
        """Return the series without the frame that is its reference, if there is one."""
        if not self.of_series:
            return self
        every = self.frames.coefficients
        if isinstance(every, FrameSplines):
            later: FloatArray | FrameSplines = replace(every, first=every.first + 1)
        else:
            later = np.asarray(every)[1:]
        return replace(self, frames=replace(self.frames, coefficients=later), of_series=False)

    def rescaled(self, gains: FloatArray) -> SurfaceImages:
        """Return the series with its frames brought to the height of the reference.

        Args:
            gains: heights of each frame over those of the reference, shape (T,).
        """
        if (gains == 1.0).all():
            return self
        rescaling, every = Rescaling(gains, self.rows, self.cols), self.frames.coefficients
        if isinstance(every, FrameSplines):
            scaled: FloatArray | FrameSplines = replace(every, rescaling=rescaling)
        else:
            scaled = np.array([rescaling.of(t, every[t]) for t in range(len(every))])
        return replace(self, frames=replace(self.frames, coefficients=scaled))

    def only(self, index: IntArray) -> SurfaceImages:
        """Return some frames of the series, their splines kept in memory."""
        kept = np.empty((len(index), *self.shape))
        for place, t in enumerate(index.tolist()):
            kept[place] = self.frames.coefficients[t]
        with_first = self.of_series and index[:1].tolist() == [0]
        return replace(self, frames=replace(self.frames, coefficients=kept), of_series=with_first)

    def kept(self) -> SurfaceImages:
        """Return the series with the splines of all its frames kept in memory."""
        if isinstance(self.frames.coefficients, np.ndarray):
            return self
        return self.only(np.arange(self.n_frames))

    def blocks(self) -> Iterator[tuple[IntArray, SurfaceImages]]:
        """All frames, some at a time: their numbers, and these frames kept in memory."""
        together = max(1, _BLOCK // max(1, self.shape[0] * self.shape[1]))
        for first in range(0, self.n_frames, together):
            index = np.arange(first, min(first + together, self.n_frames))
            yield index, self.only(index)

    def box(self, margin: int = 0) -> tuple[slice, slice]:
        """Rows and columns of the images around the region of interest.

        Args:
            margin: pixels more on each side, as far as the images reach.
        """
        rows, cols = (
            slice(max(int(at.min()) - margin, 0), min(int(at.max()) + 1 + margin, n))
            for at, n in zip((self.rows, self.cols), self.shape, strict=True)
        )
        return rows, cols

    def sampled(self, spline: FloatArray, box: tuple[slice, slice]) -> FloatArray:
        """Heights of a frame at the pixels of a box [µm], extended over gaps.

        Args:
            spline: coefficients of the frame, shape (rows, cols).
            box: rows and columns.
        """
        # A sample feels the coefficients beside it, mirrored where the image ends.
        wide = tuple(slice(max(part.start - 1, 0), part.stop + 1) for part in box)
        inner = tuple(
            slice(part.start - more.start, part.stop - more.start)
            for part, more in zip(box, wide, strict=True)
        )
        seen = samples(spline[wide])[inner]
        return fill_off_surface(seen, on_surface(seen))

    def residual(self, motion: FloatArray, index: IntArray | None = None) -> FloatArray:
        """ρ = f(x) + w − g(x + u, y + v) [µm], NaN next to a pixel that the frame lacks.

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
        """Variance of ρ from noise alone [µm²], shape (T, n_pix), see `residual_variance`."""
        at = self.xy / self.pixel + self.frames.origin
        shift = motion[..., :2] / self.pixel
        return residual_variance(at, shift, self.sigma, self.n_reference, self.sigma_flat)

    def chi(
        self,
        motion: PixelFields,
        n_parameters: float | FloatArray = 0.0,
    ) -> FloatArray:
        """Residual of each frame in units of noise, shape (T,), see `residual_chi`.

        Args:
            motion: of every frame.
            n_parameters: degrees of freedom of the motion that were fitted, of all frames or (T,).
        """
        fitted = np.broadcast_to(n_parameters, self.n_frames)
        return np.concatenate(
            [some._chi(motion[index], fitted[index]) for index, some in self.blocks()]
        )

    def _chi(self, motion: FloatArray, fitted: float | FloatArray = 0.0) -> FloatArray:
        variance = self.expected_residual_variance(motion)
        return residual_chi(self.residual(motion), variance, fitted)


def prepare(
    frames: HeightMaps,
    repeats: FloatArray | None,
    flat: FlatField | None,
    pixel: float,
    origin: tuple[float, float],
    bounds: Bounds,
    mask: BoolArray | None = None,
    mask_dust: bool = True,
    stated_noise: float = 0.0,
) -> SurfaceImages:
    """Correct the images and gather what correlation needs.

    The flat pattern is subtracted; repeats that moved significantly are registered to the
    first one; pixels that a repeat lacks are, with a margin, kept out of the region of interest,
    as is dust; without repeats frame 0 stands for them; what a frame lacks is left out of that
    frame alone, see `mark_gaps`.

    Args:
        frames: height maps of the series [µm]; they are read whenever they are needed.
        repeats: height maps of the unloaded surface [µm], shape (n, rows, cols), or None.
        flat: fixed pattern to subtract, if known.
        pixel: size of a pixel [µm].
        origin: (row, column) of X = 0, Y = 0 in the repeats.
        bounds: rectangle (x0, x1, y0, y1) of the region of interest [µm].
        mask: pixels that may be used, shape (rows, cols); all if None.
        mask_dust: whether isolated spikes of the repeats are left out.
        stated_noise: noise of an image at a pixel [µm], where there are no repeats.

    Raises:
        ImageError: sizes that differ, a frame without heights, or an empty region of interest.
    """
    shape = frames.shape[1:] if repeats is None else repeats.shape[1:]
    for name, found in (
        ("frames", frames.shape[1:]),
        ("flat pattern", shape if flat is None else flat.pattern.shape),
        ("mask", shape if mask is None else mask.shape),
    ):
        if found != shape:
            raise ImageError(f"{name} of {found} px, but the repeats have {shape} px.")
    place = flat, pixel, origin, bounds, mask, mask_dust
    if repeats is None:
        reference = stated_reference(frames[0], stated_noise, *place)
    else:
        reference = build_reference(repeats, *place)
    smooth = ndimage.gaussian_filter(reference.heights, SMOOTHING)
    for t, heights in enumerate(frames):
        if not on_surface(heights).any():
            raise ImageError(f"frame {t}: no pixel carries a height (all empty).")
    splines = SplineImages(FrameSplines(frames, flat), pixel, origin)
    images = over_region(reference, splines, smooth, flat, bounds)
    images = replace(images, of_series=repeats is None)
    return images if len(frames) * reference.heights.size > _KEPT else images.kept()


def over_region(
    reference: Reference,
    frames: SplineImages,
    relief: FloatArray,
    flat: FlatField | None,
    bounds: Bounds,
) -> SurfaceImages:
    """Gather what correlation needs over the region of a reference.

    Args:
        reference: the reference surface.
        frames: the images of the series; none of them need be there.
        relief: heights of whose spline the gradient is taken [µm], shape (rows, cols).
        flat: fixed pattern that was subtracted, if any.
        bounds: rectangle (x0, x1, y0, y1) of the region of interest [µm].
    """
    pixel, origin, shape = frames.pixel, frames.origin, reference.heights.shape
    pattern = None if flat is None else without_noise(flat)
    rows, cols = np.nonzero(reference.region)
    xy = np.column_stack([(rows - origin[0]) * pixel, (cols - origin[1]) * pixel])
    return SurfaceImages(
        xy=xy,
        rows=rows,
        cols=cols,
        reference=reference.heights[rows, cols],
        gradient=spline_images(relief[None], pixel, origin).gradient(0, xy[:, 0], xy[:, 1]),
        frames=frames,
        sigma=reference.noise.sigma,
        n_reference=reference.n,
        shape=(shape[0], shape[1]),
        pixel=pixel,
        bounds=bounds,
        reference_image=reference.heights,
        noise_dof=reference.noise.dof,
        sigma_flat=0.0 if flat is None else flat.sigma,
        flat_error=np.zeros(shape) if flat is None else flat.error,
        flat_pattern=pattern,
        flat_noise=np.zeros(shape) if flat is None or pattern is None else flat.pattern - pattern,
        codes=reference.codes,
        repeat_stretch=reference.stretch,
    )


def refine_gradient(images: SurfaceImages, motion: PixelFields) -> SurfaceImages:
    """Take the gradient from the mean of the repeats and of all frames, warped back.

    The mean of n + T images has little noise of its own to be mistaken for pattern. A frame
    counts by 1/χ², so that one with an artefact does not spoil it, and not at all at the pixels
    that it lacks. The noise of the flats, fixed in the camera, does not average out: it is taken
    away, for a gradient that holds it sees it stand still, and the surface with it (20 flats took a
    quarter of each motion below a pixel on a relief of 3.6 nm/px). The reference values stay
    those of the repeats alone: later statistics need to know whose noise they carry.

    Args:
        images: the series.
        motion: motion of every frame from a first correlation.
    """
    roi = np.zeros(images.shape, dtype=bool)
    roi[images.rows, images.cols] = True
    ring = ndimage.binary_dilation(roi, iterations=RING)
    rows, cols = np.nonzero(ring)
    pixel_of = np.zeros(images.shape, dtype=np.int64)
    pixel_of[images.rows, images.cols] = np.arange(len(images.rows))
    nearest = ndimage.distance_transform_edt(~roi, return_distances=False, return_indices=True)
    on_ring = pixel_of[tuple(nearest)][rows, cols]
    places = (np.column_stack([rows, cols]) - images.frames.origin) * images.pixel
    fixed = spline_images(images.flat_noise[None], images.pixel, images.frames.origin)
    total = images.n_reference * (images.reference_image + images.flat_noise)[rows, cols]
    count = np.full(len(rows), float(images.n_reference))
    for index, some in images.blocks():
        fields = motion[index]
        weights = np.maximum(some._chi(fields), 1.0) ** -2.0
        weights[images.is_reference[index]] = 0.0  # it counts as the reference
        for t, weight in enumerate(weights):
            carried = fields[t, on_ring]
            at = (places + carried[:, :2]).T
            warped = some.frames.value(t, *at) + fixed.value(0, *at) - carried[:, 2]
            seen = np.isfinite(warped)
            total[seen] += weight * warped[seen]
            count += weight * seen
    mean = images.reference_image + images.flat_noise
    mean[rows, cols] = total / count
    spline = spline_images(mean[None], images.pixel, images.frames.origin)
    return replace(images, gradient=spline.gradient(0, images.xy[:, 0], images.xy[:, 1]))
