"""Rigid translation between two height maps."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from driver.experiment.images.heightmaps import ImageError, fill_off_surface, on_surface
from driver.experiment.images.plane import plane_modes
from meshes.arrays import BoolArray, ComplexArray, FloatArray

SMOOTHING = 1.0  # px; of the gradient only, against noise that would dampen the steps
BANDWIDTH = 0.12  # cycles/px; phases beyond are noise on a pattern of several pixels
TOLERANCE = 1e-5  # px
MAX_ITERATIONS = 60


class Shift(NamedTuple):
    """Translation of the surface from the reference to the image: dx, dy, dz [µm]."""

    dx: float
    dy: float
    dz: float


def shift_between(
    reference: FloatArray, image: FloatArray, pixel: float, mask: BoolArray | None = None
) -> Shift:
    """Return the translation (dx, dy, dz) such that image(x + dx, y + dy) = reference(x, y) + dz.

    Phase correlation over the bounding box of the mask finds the start, unless no motion leaves
    less; Gauss–Newton on the heights over the mask finishes, with a tilt between the two images
    free. Where the surface also deforms, it is the mean motion, weighed by the squared slopes.
    x runs along the rows' index, y along the columns' index.

    Args:
        reference: heights [µm], shape (rows, cols).
        image: heights [µm], same shape.
        pixel: size of a pixel [µm].
        mask: pixels of the reference to use; all if None.

    Raises:
        ImageError: the shapes differ, a map has no height, or the masked surface has no relief.
    """
    if reference.shape != image.shape:
        raise ImageError(f"image of shape {image.shape}; the reference has {reference.shape}.")
    valid = [on_surface(heights) for heights in (reference, image)]
    if not all(v.any() for v in valid):
        raise ImageError("an image holds no height: every pixel is empty or at level 0.")
    f = fill_off_surface(reference, valid[0])
    g = fill_off_surface(image, valid[1])
    rows, cols = np.nonzero(np.ones(f.shape, bool) if mask is None else mask)
    box = np.s_[rows.min() : rows.max() + 1, cols.min() : cols.max() + 1]
    jump = phase_correlation(_without_plane(f[box]), _without_plane(g[box]))
    return _gauss_newton(f, g, [jump, (0.0, 0.0)], rows, cols, pixel)


def phase_correlation(f: FloatArray, g: FloatArray) -> tuple[float, float]:
    """Shift (rows, cols) [px] of g against f, to a fraction of a pixel, |shift| < size/2.

    The cross-power spectrum is whitened within the band of the pattern only, and the peak is
    interpolated by a parabola in each direction.
    """
    return spectral_shift(spectrum(f), spectrum(g), (f.shape[0], f.shape[1]))


def spectrum(heights: FloatArray) -> ComplexArray:
    """Return what `spectral_shift` needs of an image: the spectrum of its tapered heights."""
    taper, _ = _filters((heights.shape[0], heights.shape[1]))
    return np.asarray(np.fft.rfft2((heights - heights.mean()) * taper))


def spectral_shift(f: ComplexArray, g: ComplexArray, shape: tuple[int, int]) -> tuple[float, float]:
    """`phase_correlation` of two images of a shape whose spectra are known."""
    _, band = _filters(shape)
    cross = np.conj(f) * g
    magnitude = np.abs(cross)
    cross *= np.divide(band, magnitude, out=np.zeros_like(band), where=magnitude > 0)
    peak = np.fft.irfft2(cross, shape)
    top = np.unravel_index(int(peak.argmax()), peak.shape)
    shift = []
    for axis, at in enumerate(top):
        n = peak.shape[axis]
        line = np.take(peak, top[1 - axis], axis=1 - axis)
        before, highest, after = line[at - 1], line[at], line[(at + 1) % n]
        curvature = before - 2.0 * highest + after
        offset = 0.5 * (before - after) / curvature if curvature < 0 else 0.0
        shift.append(float((at + n // 2) % n - n // 2 + offset))
    return shift[0], shift[1]


@lru_cache(maxsize=8)
def _filters(shape: tuple[int, int]) -> tuple[FloatArray, FloatArray]:
    """Taper of an image, and band of its real spectrum."""
    taper = np.outer(np.hanning(shape[0] + 2)[1:-1], np.hanning(shape[1] + 2)[1:-1])
    frequency = np.hypot(np.fft.fftfreq(shape[0])[:, None], np.fft.rfftfreq(shape[1]))
    return taper, np.exp(-0.5 * (frequency / BANDWIDTH) ** 2)


def _gauss_newton(
    f: FloatArray,
    g: FloatArray,
    starts: Sequence[tuple[float, float]],
    rows: NDArray[np.int64],
    cols: NDArray[np.int64],
    pixel: float,
) -> Shift:
    """Refine the start that leaves the least."""
    # ρ = f + w − g(x + u): its Jacobian is −∇f with ∇f = (∂f/∂x, ∂f/∂y, −1); w is a plane.
    plane = plane_modes(rows.astype(np.float64), cols.astype(np.float64))
    # The slopes of the plane would only tell w from the shift, and bend at the border.
    relief = _without_plane(f)
    smooth, sharp = (
        np.column_stack([*(slope[rows, cols] for slope in slopes), -plane])
        for slopes in (
            [ndimage.gaussian_filter(relief, SMOOTHING, order=axes) for axes in ((1, 0), (0, 1))],
            [np.gradient(relief, axis=axis) for axis in (0, 1)],
        )
    )
    if np.linalg.matrix_rank(smooth) < 5:
        raise ImageError("the reference surface has no relief: a shift cannot be measured.")
    # The smoothed slopes choose where ρ is to vanish, the sharp ones say how far that is: with
    # the smoothed ones in both places a relief of a few pixels would be overshot.
    hessian = smooth.T @ sharp
    coefficients = ndimage.spline_filter(g, order=3, mode="mirror")

    def residual(shift: Sequence[float] | FloatArray) -> FloatArray:
        moved = ndimage.map_coordinates(
            coefficients, [rows + shift[0], cols + shift[1]], mode="mirror", prefilter=False
        )
        return np.asarray(f[rows, cols] - moved)

    def left(start: tuple[float, float]) -> float:
        rho = residual(start)
        return float(np.sum((rho - plane @ (plane.T @ rho)) ** 2))

    start = np.array([*min(starts, key=left), 0.0, 0.0, 0.0])
    shift = start
    for _ in range(MAX_ITERATIONS):
        update = np.linalg.solve(hessian, smooth.T @ (residual(shift) + plane @ shift[2:]))
        shift = shift + update
        if np.abs(update[:2]).max() < TOLERANCE:
            break
        if np.any(np.abs(shift[:2]) > f.shape):  # another surface: there is nothing to refine
            shift = start
            break
    dz = float((plane @ shift[2:]).mean())
    return Shift(float(shift[0] * pixel), float(shift[1] * pixel), dz)


def _without_plane(heights: FloatArray) -> FloatArray:
    rows, cols = np.indices(heights.shape, dtype=np.float64)
    plane = plane_modes(rows.ravel(), cols.ravel())
    flat = heights.ravel()
    return np.asarray(flat - plane @ (plane.T @ flat)).reshape(heights.shape)
