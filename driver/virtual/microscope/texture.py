"""A measured height map as a function of position, finer than the splines of correlation.

The map, mirrored about the outer sides of its border pixels, is the sum of cosines that passes
through every pixel (its discrete cosine transform): no interpolation of it is more faithful to what
the pixels hold up to half a cycle a pixel. For speed the sum is tabulated four times finer than the
pixels and read there with quintic splines, whose error is then measured against the sum itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import fft, ndimage

from meshes.arrays import FloatArray

_FINER = 4
_ORDER = 5


@dataclass(frozen=True, eq=False)
class Texture:
    """A height map as a relief.

    Attributes:
        heights: the map [µm], without gaps, shape (rows, columns).
        pixel: side of a pixel [µm].
        origin: (row, column) of X = 0, Y = 0.
        table: spline coefficients on the finer grid of the mirrored map.
    """

    heights: FloatArray
    pixel: float
    origin: tuple[float, float]
    table: FloatArray

    def __call__(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Heights [µm] at positions [µm] of any shape; beyond the map they are mirrored."""
        places = [p / self.pixel + o for p, o in zip((x, y), self.origin, strict=True)]
        return np.asarray(
            ndimage.map_coordinates(
                self.table,
                [_FINER * p for p in places],
                order=_ORDER,
                mode="grid-wrap",
                prefilter=False,
            )
        )

    def cosine_sum(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the sum of cosines itself at some positions [µm], slowly, shape (n,)."""
        amplitudes = fft.dctn(self.heights, type=2, norm="forward")
        waves = []
        for p, o, n in zip((x, y), self.origin, self.heights.shape, strict=True):
            k = np.arange(n)
            turns = np.pi * np.outer(p / self.pixel + o + 0.5, k) / n
            waves.append(np.cos(turns) * np.where(k > 0, 2.0, 1.0))
        return np.asarray(np.einsum("pi,ij,pj->p", waves[0], amplitudes, waves[1]))

    def error(self, number: int = 500) -> float:
        """Rms difference between the table and the sum at random places of the map [µm]."""
        ends = np.array(self.heights.shape) - 1.0
        rows, columns = np.random.default_rng(0).uniform((0, 0), ends, (number, 2)).T
        x, y = (rows - self.origin[0]) * self.pixel, (columns - self.origin[1]) * self.pixel
        return float(np.sqrt(np.mean((self(x, y) - self.cosine_sum(x, y)) ** 2)))


def texture(heights: FloatArray, pixel: float, origin: tuple[float, float]) -> Texture:
    """Return a height map [µm] without gaps, shape (rows, columns), as a function of position."""
    # Its import takes a second, with scipy.stats.
    from scipy.signal import resample

    fine = np.pad(heights, [(0, n) for n in heights.shape], mode="symmetric")
    for axis, n in enumerate(heights.shape):
        fine = resample(fine, 2 * n * _FINER, axis=axis)
    table = ndimage.spline_filter(fine, order=_ORDER, mode="grid-wrap")
    return Texture(heights, pixel, origin, np.asarray(table))
