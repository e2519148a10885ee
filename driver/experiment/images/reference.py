"""The reference surface: the mean of repeated images, where it can be used, and its noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from driver.common.distributions import chi2_isf
from driver.common.splines.images import variance_gain
from driver.experiment.images.flatfield import FlatField
from driver.experiment.images.heightmaps import ImageError, fill_off_surface, on_surface
from driver.experiment.images.noise import Noise, noise_from_repeats
from driver.experiment.images.region import Bounds, CodeArray, Excluded, region_codes
from driver.experiment.images.repeat_stretch import RepeatStretch, stretch_of_repeats
from driver.experiment.images.rigid import shift_between
from driver.experiment.images.spikes import spikes, strays
from meshes.arrays import BoolArray, FloatArray

SMOOTHING = 1.0  # px; of the slopes by which the shifts of the repeats are weighed
SIGNIFICANCE = 1e-3  # chance of registering repeats that did not move


@dataclass(frozen=True, eq=False)
class Reference:
    """Mean of n repeats, or image 0 of a series whose noise is stated.

    Attributes:
        heights: the mean, extended over trenches [µm], shape (rows, cols).
        codes: what becomes of each pixel, values of `Excluded`, shape (rows, cols).
        noise: of one image at a pixel.
        n: number of images in the mean.
        shifts: motion of each repeat against the first [µm], along X, Y, Z, shape (n, 3).
        registered: whether they were moved back: the shifts are more than noise.
        stretch: strain between the repeats, None without.
    """

    heights: FloatArray
    codes: CodeArray
    noise: Noise
    n: int
    shifts: FloatArray
    registered: bool
    stretch: RepeatStretch | None = None

    @property
    def region(self) -> BoolArray:
        """The pixels that are used, shape (rows, cols)."""
        return np.asarray(self.codes == Excluded.USED)

    def count(self, reason: Excluded) -> int:
        """Return the number of pixels with this code."""
        return int(np.count_nonzero(self.codes == reason))


def build_reference(
    repeats: FloatArray,
    flat: FlatField | None,
    pixel: float,
    origin: tuple[float, float],
    bounds: Bounds,
    mask: BoolArray | None = None,
    mask_dust: bool = True,
) -> Reference:
    """Correct the repeats, find where they can be used, register and average them.

    Dust is looked for twice: spikes of the median of the repeats, before they are registered,
    and strays of single repeats, afterwards.

    Args:
        repeats: height maps of the unloaded surface [µm], shape (n, rows, cols).
        flat: fixed pattern to subtract, if known.
        pixel: size of a pixel [µm].
        origin: (row, column) of X = 0, Y = 0 in the repeats.
        bounds: rectangle (x0, x1, y0, y1) of the face without its rim [µm].
        mask: pixels that may be used, shape (rows, cols); all if None.
        mask_dust: whether dust is left out.

    Raises:
        ImageError: a repeat without heights, no pixel that can be used, or no noise.
    """
    codes = region_codes(np.asarray(on_surface(repeats).all(axis=0)), pixel, origin, bounds, mask)
    repeats = np.stack([corrected(r, flat, f"repeat {t}") for t, r in enumerate(repeats)])
    if mask_dust:
        codes[spikes(np.median(repeats, axis=0), codes == Excluded.USED)] = Excluded.DUST
    used = np.asarray(codes == Excluded.USED)
    _refuse_dust_alone(codes)
    shifts = np.array([np.zeros(3), *(shift_between(repeats[0], r, pixel, used)
                                      for r in repeats[1:])])  # fmt: skip
    noise = noise_from_repeats(repeats, used)
    registered = _moved(repeats, shifts, used, noise.sigma, pixel)
    gains = np.ones(len(repeats))
    if registered:
        repeats, gains = _moved_back(repeats, shifts, pixel)
    if mask_dust:
        codes[strays(repeats, used)] = Excluded.DUST
        used = np.asarray(codes == Excluded.USED)
    noise = noise_from_repeats(repeats, used, n_shifts=2 if registered else 0)
    of_one = noise.sigma / float(np.sqrt(gains.mean()))
    return Reference(
        heights=np.asarray(repeats.mean(axis=0)),
        codes=codes,
        noise=Noise(of_one, noise.dof),
        n=len(repeats),
        shifts=shifts,
        registered=registered,
        stretch=stretch_of_repeats(repeats, used, pixel, of_one),
    )


def stated_reference(
    first: FloatArray,
    sigma: float,
    flat: FlatField | None,
    pixel: float,
    origin: tuple[float, float],
    bounds: Bounds,
    mask: BoolArray | None = None,
    mask_dust: bool = True,
) -> Reference:
    """Return image 0 as the reference, its noise as it is stated.

    Of dust the spikes of that image are found: strays of single repeats take repeats.

    Args:
        first: image 0 [µm], shape (rows, cols).
        sigma: noise of an image at a pixel [µm].
        flat: as of `build_reference`.
        pixel: as of `build_reference`.
        origin: as of `build_reference`.
        bounds: as of `build_reference`.
        mask: as of `build_reference`.
        mask_dust: as of `build_reference`.

    Raises:
        ImageError: it has no height, or no pixel that can be used.
    """
    codes = region_codes(np.asarray(on_surface(first)), pixel, origin, bounds, mask)
    heights = corrected(first, flat, "frame 0")
    if mask_dust:
        codes[spikes(heights, codes == Excluded.USED)] = Excluded.DUST
    _refuse_dust_alone(codes)
    return Reference(heights, codes, Noise(sigma, 0), 1, np.zeros((1, 3)), registered=False)


def _refuse_dust_alone(codes: CodeArray) -> None:
    if not (codes == Excluded.USED).any():
        raise ImageError(
            "images.dust: every pixel of the face stands out of its neighbours, expected isolated "
            'spikes; with images.dust = "keep" they are used'
        )


def corrected(heights: FloatArray, flat: FlatField | None, name: str) -> FloatArray:
    """Return a height map less the flat pattern, extended over pixels without a height.

    Args:
        heights: one height map [µm], shape (rows, cols).
        flat: fixed pattern to subtract, if known.
        name: what the image is, to be told.

    Raises:
        ImageError: it has no height.
    """
    valid = on_surface(heights)
    if not valid.any():
        raise ImageError(f"{name}: no pixel carries a height (all empty).")
    return fill_off_surface(heights if flat is None else heights - flat.pattern, valid)


def _moved(
    repeats: FloatArray, shifts: FloatArray, region: BoolArray, sigma: float, pixel: float
) -> bool:
    """Whether the shifts are more than noise.

    Those against a common first repeat share its noise: their covariance is
    σ² M⁻¹ (I + 1 1ᵀ), so that Σ (s − s̄)ᵀ M (s − s̄)/σ² is χ² with 2 (n − 1) degrees of freedom.
    """
    smooth = ndimage.gaussian_filter(repeats.mean(axis=0), SMOOTHING)
    slopes = np.column_stack([g[region] for g in np.gradient(smooth, pixel)])
    slopes -= slopes.mean(axis=0)
    own = shifts[:, :2] - shifts[:, :2].mean(axis=0)
    statistic = np.einsum("ti,ij,tj->", own, slopes.T @ slopes, own) / sigma**2
    return bool(statistic >= chi2_isf(SIGNIFICANCE, 2 * (len(repeats) - 1)))


def _moved_back(
    repeats: FloatArray, shifts: FloatArray, pixel: float
) -> tuple[FloatArray, FloatArray]:
    """Return repeats on the first one, and what interpolation leaves of their noise variance."""
    grid = np.indices(repeats.shape[1:], dtype=np.float64)
    registered, gains = [repeats[0]], [1.0]
    for heights, (dx, dy, dz) in zip(repeats[1:], shifts[1:], strict=True):
        step = np.array([dx, dy]) / pixel
        moved = ndimage.map_coordinates(heights, grid + step[:, None, None], mode="mirror")
        registered.append(moved - dz)
        gains.append(float(variance_gain(step[0], step[1])))
    return np.array(registered), np.array(gains)
