"""Cubic B-spline interpolation of a stack of height maps at positions in µm."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike
from scipy import ndimage

from driver.common.splines.kernels import POLE, coefficients
from meshes.arrays import FloatArray
from solver_adapters.kernels import compiled

Number = TypeVar("Number", float, FloatArray)


class Splines(Protocol):
    """Spline coefficients of T images, one after the other; an array (T, rows, cols) is such."""

    def __len__(self) -> int:
        """Return the number T of images."""

    def __getitem__(self, index: int, /) -> FloatArray:
        """Coefficients of one image [µm], shape (rows, cols)."""


@dataclass(frozen=True, eq=False)
class SplineImages:
    """Height maps as continuous functions of position.

    Attributes:
        coefficients: cubic B-spline coefficients [µm], mirrored at the border pixels, of T images.
        pixel: size of a pixel [µm].
        origin: (row, column) of the point X = 0, Y = 0.
    """

    coefficients: Splines
    pixel: float
    origin: tuple[float, float]

    def value(self, index: ArrayLike, x: FloatArray, y: FloatArray) -> FloatArray:
        """Heights [µm] at positions X, Y [µm].

        Args:
            index: one frame, with positions of any shape; or frames of shape (T,), with
                positions of shape (T, n) or (n,).
            x: along the rows' index.
            y: along the columns' index.
        """
        return np.asarray(self._at(_values, 1, index, x, y)[0])

    def gradient(self, index: ArrayLike, x: FloatArray, y: FloatArray) -> FloatArray:
        """Slopes ∂/∂X, ∂/∂Y [-] at positions [µm], stacked along a last axis of two."""
        _, d_row, d_col = self._at(_evaluate, 3, index, x, y)
        return np.stack([d_row, d_col], axis=-1) / self.pixel

    def _at(
        self, kernel: Any, n_values: int, index: ArrayLike, x: FloatArray, y: FloatArray
    ) -> FloatArray:
        """Return what a kernel tells at positions, shape (n_values, ...)."""
        frames = np.atleast_1d(np.asarray(index, dtype=np.int64)).tolist()
        shape = np.broadcast_shapes(x.shape, y.shape, (len(frames), 1) if np.ndim(index) else ())
        rows, cols = (
            np.array(np.broadcast_to(p / self.pixel + o, shape)).reshape(len(frames), -1)
            for p, o in zip((x, y), self.origin, strict=True)
        )
        values = np.empty((n_values, *rows.shape))
        for m, t in enumerate(frames):
            values[:, m] = kernel(self.coefficients[t], rows[m], cols[m])
        return values.reshape(n_values, *shape)


def spline_images(stack: FloatArray, pixel: float, origin: tuple[float, float]) -> SplineImages:
    """Spline coefficients of height maps [µm], shape (T, rows, cols), without gaps."""
    stacked = np.stack([coefficients(np.ascontiguousarray(h, dtype=np.float64)) for h in stack])
    return SplineImages(coefficients=stacked, pixel=pixel, origin=origin)


def samples(spline: FloatArray) -> FloatArray:
    """Return the pixels of an image from its spline coefficients."""
    knot = np.array([1.0, 4.0, 1.0]) / 6
    rows = ndimage.correlate1d(spline, knot, axis=0, mode="mirror")
    return np.asarray(ndimage.correlate1d(rows, knot, axis=1, mode="mirror"))


def variance_gain(fraction_x: FloatArray, fraction_y: FloatArray) -> FloatArray:
    """Variance of interpolated white pixel noise, relative to that of a pixel.

    The interpolated value is a sum of pixels weighted by the cardinal spline
    η = q * β³, q_k = −6 z/(1 − z²) z^|k| with z = √3 − 2; the gain is Σ η(x − k)² in each
    direction: 1 on a pixel, 0.76 midway between two.

    Args:
        fraction_x: position along the rows' index [px]; only its fraction counts.
        fraction_y: position along the columns' index [px].
    """
    x, y = np.broadcast_arrays(fraction_x, fraction_y)
    gains = _gains(np.ravel(x), np.ravel(y), _GAIN)
    return np.asarray(gains).reshape(x.shape)


def noise_autocorrelation(fraction: FloatArray, reach: int) -> FloatArray:
    """Covariance of white noise interpolated at places a whole number of pixels apart.

    Σ_k η(t − k) η(t + d − k), for η see `variance_gain`, which is its value at d = 0. What one
    place loses its neighbours share: the sum over all d is 1, so that slow noise stays whole.

    Args:
        fraction: place t between two pixels [px], shape (m,); only its fraction counts.
        reach: largest distance d [px].

    Returns:
        Shape (m, reach + 1), for d from 0.
    """
    t = fraction - np.floor(fraction)
    return np.stack([np.polyval(_shared_noise(d), t) for d in range(reach + 1)], axis=-1)


def _weights(t: Number) -> tuple[Number, Number, Number, Number]:
    s = 1.0 - t
    return (
        s * s * s / 6.0,
        2.0 / 3.0 - t * t * (1.0 - 0.5 * t),
        2.0 / 3.0 - s * s * (1.0 - 0.5 * s),
        t * t * t / 6.0,
    )


def _shared_noise(distance: int) -> FloatArray:
    """Coefficients of Σ_k η(t − k) η(t + d − k) in 0 ≤ t ≤ 1, highest power first."""
    # With w the weights of β³ at t, that is Σ_ij w_i w_j R(d + i − j), R the autocorrelation of
    # the prefilter q: Σ_j z^|j| z^|j+k| = z^|k| (|k| + (1 + z²)/(1 − z²)).
    scale = -6.0 * POLE / (1.0 - POLE**2)
    weights: Any = _weights(cast(Any, np.poly1d([1.0, 0.0])))
    total = np.poly1d([0.0])
    for i, j in np.ndindex(4, 4):
        lag = abs(distance + i - j)
        shared = scale**2 * POLE**lag * (lag + (1.0 + POLE**2) / (1.0 - POLE**2))
        total = total + float(shared) * weights[i] * weights[j]
    return np.asarray(total.coeffs)


_GAIN = _shared_noise(0)


def _gains_at_points(x: FloatArray, y: FloatArray, polynomial: FloatArray) -> FloatArray:
    gains = np.empty_like(x)
    for k in range(len(x)):
        s, t = x[k] - np.floor(x[k]), y[k] - np.floor(y[k])
        along, across = 0.0, 0.0
        for c in polynomial:
            along, across = along * s + c, across * t + c
        gains[k] = along * across
    return gains


def _fold(k: int, n: int) -> int:
    """Index of a pixel of a line of n, mirrored about the centres of its end pixels."""
    if n == 1:
        return 0
    k = abs(k) % (2 * n - 2)
    return k if k < n else 2 * n - 2 - k


def _slopes(t: float) -> tuple[float, float, float, float]:
    s = 1.0 - t
    return -0.5 * s * s, t * (1.5 * t - 2.0), s * (2.0 - 1.5 * s), 0.5 * t * t


_compiled = compiled()
_weights_at = _compiled(_weights)
_slopes_at = _compiled(_slopes)
_folded = _compiled(_fold)


def _evaluate_points(
    image: FloatArray, rows: FloatArray, cols: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Value and derivatives along rows and columns [1/px] at points of one image."""
    n_rows, n_cols = image.shape
    value = np.empty_like(rows)
    d_row = np.empty_like(rows)
    d_col = np.empty_like(rows)
    for p in range(len(rows)):
        r, c = int(np.floor(rows[p])), int(np.floor(cols[p]))
        a, da = _weights_at(rows[p] - r), _slopes_at(rows[p] - r)
        b, db = _weights_at(cols[p] - c), _slopes_at(cols[p] - c)
        total, along_row, along_col = 0.0, 0.0, 0.0
        inside = r >= 1 and c >= 1 and r + 2 < n_rows and c + 2 < n_cols
        for i in range(4):
            k = r - 1 + i if inside else _folded(r - 1 + i, n_rows)
            line, slope = 0.0, 0.0
            for j in range(4):
                q = image[k, c - 1 + j if inside else _folded(c - 1 + j, n_cols)]
                line += b[j] * q
                slope += db[j] * q
            total += a[i] * line
            along_row += da[i] * line
            along_col += a[i] * slope
        value[p], d_row[p], d_col[p] = total, along_row, along_col
    return value, d_row, d_col


_gains = _compiled(_gains_at_points)
_evaluate = _compiled(_evaluate_points)


def _values_at_points(image: FloatArray, rows: FloatArray, cols: FloatArray) -> tuple[FloatArray]:
    """Values at points of one image."""
    n_rows, n_cols = image.shape
    value = np.empty_like(rows)
    for p in range(len(rows)):
        r, c = int(np.floor(rows[p])), int(np.floor(cols[p]))
        a, b = _weights_at(rows[p] - r), _weights_at(cols[p] - c)
        total = 0.0
        if r >= 1 and c >= 1 and r + 2 < n_rows and c + 2 < n_cols:
            for i in range(4):
                line = 0.0
                for j in range(4):
                    line += b[j] * image[r - 1 + i, c - 1 + j]
                total += a[i] * line
        else:
            for i in range(4):
                k, line = _folded(r - 1 + i, n_rows), 0.0
                for j in range(4):
                    line += b[j] * image[k, _folded(c - 1 + j, n_cols)]
                total += a[i] * line
        value[p] = total
    return (value,)


_values = _compiled(_values_at_points)
