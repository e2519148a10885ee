"""Noise that the images of a series have in common, as a covariance in time.

All share the reference, a mean of n images. They also share the error e of the flat pattern, white
over the camera: what frame t has of it is e(x + u_t) − e(x). With ρ the autocorrelation of the
weights by which pixels are tested, and d_t the displacement of a place, what two frames have in
common is ρ(d_t − d_s) − ρ(d_t) − ρ(d_s) + 1 times the variance of e, which is slow wherever the
specimen moves slowly.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import scipy.sparse as sp
from scipy import fft, ndimage

from driver.dic.surface_images import SurfaceImages
from meshes.arrays import FloatArray

_TESTS = 24  # numbers of an image of whose weights the autocorrelation is the mean


def reference_noise(
    images: SurfaceImages, test: sp.csr_array, whiten: FloatArray, places: FloatArray
) -> FloatArray:
    """Covariance between the frames beside their own noise, in units of its variance, (T, T).

    Args:
        images: the series.
        test: ∇f·ψ_j at the pixels, shape (n_pix, n_functions).
        whiten: what turns numbers tested by them into independent ones, shape (n_z, n_functions).
        places: displacement of some places of the specimen in the frames [µm], shape (T, p, 2).
    """
    T = len(places)
    shared = np.full((T, T), 1.0 / images.n_reference)
    if images.sigma_flat:
        moved = places / images.pixel
        some = np.unique(np.linspace(0, len(whiten) - 1, _TESTS).astype(np.int64))
        weights = (test @ row for row in whiten[some])
        shared += (images.sigma_flat / images.sigma) ** 2 * _of_pattern(images, weights, moved)
    return shared


def _of_pattern(
    images: SurfaceImages, weights: Iterable[FloatArray], places: FloatArray
) -> FloatArray:
    """Return the same of the flat pattern, in units of the variance of its error.

    Args:
        images: the series.
        weights: of the pixels in some of the numbers, each of shape (n_pix,).
        places: displacement [px], shape (T, p, 2).
    """
    rows, cols = images.rows - images.rows.min(), images.cols - images.cols.min()
    shape = (2 * int(rows.max()) + 2, 2 * int(cols.max()) + 2)
    power: FloatArray = np.zeros((shape[0], shape[1] // 2 + 1))
    for weight in weights:
        field = np.zeros(shape)
        field[rows, cols] = weight
        power += np.abs(fft.rfft2(field)) ** 2
    alike = fft.fftshift(fft.irfft2(power, shape))
    middle = np.array(shape) // 2
    spline: FloatArray = ndimage.spline_filter(alike / alike[tuple(middle)])

    def rho(d: FloatArray) -> FloatArray:
        at = np.moveaxis(d, -1, 0) + middle.reshape(2, *[1] * (d.ndim - 1))
        return np.asarray(ndimage.map_coordinates(spline, at, prefilter=False))

    common = np.zeros((len(places), len(places)))
    for d in np.moveaxis(places, 1, 0):
        once = rho(d)
        common += rho(d[:, None] - d) - once[:, None] - once + 1.0
    return np.asarray(common / places.shape[1])
