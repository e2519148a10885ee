"""Covariance of what the mesh leaves wrong in a prediction.

The finer-minus-working difference is added to every prediction (defect correction). What that
leaves wrong is not known, but how large it is and when it occurs is: in the motion its root mean
square is a share κ of the correction (`mesh_error`). In time it follows the correction; in space it
is taken as a Gaussian field over the face, as rough as the finer elements and with the mean square
of the correction in each of u, v, w. The loads have one pattern (`mesh_error.load_left`).

Images resolve fractions of a nanometre where a mesh error lasts for a whole test. Without this
term every cause that resembles a mesh error would be found significant.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from meshes.arrays import FloatArray

if TYPE_CHECKING:
    from driver.identification.image_data import ImageData


_SHAPES = 3  # shapes in time that are kept: onset of yield, growth, what unloading changes


@dataclass(frozen=True, eq=False)
class DiscretisationError:
    """Σ = I + (shapes shapesᵀ) ⊗ field for the images, I + load loadᵀ for the loads.

    Attributes:
        shapes: shapes in time times their amplitudes, κ included, frames first, shape (T, m).
        field: covariance over the whitened numbers of one image, trace 1, shape (n_z, n_z).
        load: pattern of the load error [µN], shape (T,).
    """

    shapes: FloatArray
    field: FloatArray
    load: FloatArray

    @cached_property
    def _modes(self) -> tuple[FloatArray, FloatArray]:
        """Eigenvalues (n_z,) and eigenvectors (n_z, n_z) of the field."""
        strength, modes = np.linalg.eigh(self.field)
        return strength, modes

    def whiten_images(self, z: FloatArray, shapes: FloatArray) -> FloatArray:
        """Σ^(−1/2) on (..., T, n_z), with the shapes of these frames (T, m) whitened alike."""
        left, amplitude, _ = np.linalg.svd(shapes, full_matrices=False)
        strength, modes = self._modes
        gain = 1.0 / np.sqrt(1.0 + np.outer(amplitude**2, np.maximum(strength, 0.0))) - 1.0
        inside = np.einsum("tm,...tz->...mz", left, z) @ modes
        return np.asarray(z + np.einsum("tm,...mz->...tz", left, (inside * gain) @ modes.T))

    def whiten_loads(self, load: FloatArray, pattern: FloatArray) -> FloatArray:
        """Σ^(−1/2) on (..., T), with the pattern of these frames whitened alike."""
        square = float(pattern @ pattern)
        if square == 0.0:
            return load
        gain = (1.0 / np.sqrt(1.0 + square) - 1.0) / square
        return np.asarray(load + gain * np.multiply.outer(load @ pattern, pattern))


def simulation_error(
    image: ImageData, motion: FloatArray, load: FloatArray, size: float, kappa: float
) -> DiscretisationError:
    """Covariance of the remaining error.

    Args:
        image: the image part of the data.
        motion: correction of the motion at the pixels, as far as it is of the mesh [µm], shape
            (T, n_pix, 3).
        load: pattern of what is left of the load [µN], shape (T,).
        size: element size of the finer mesh [µm].
        kappa: root mean square of the error of the motion over that of its correction.
    """
    z = image.pixel_sensitivity(motion)
    left, amplitude, _ = np.linalg.svd(z, full_matrices=False)
    shapes = kappa * left[:, :_SHAPES] * amplitude[:_SHAPES]
    features = _fields(image.images.xy, size)
    spread = np.sqrt(np.mean(motion**2, axis=(0, 1)))
    effect = np.concatenate(
        [image.pixel_sensitivity(spread[c] * features[:, :, None] * np.eye(3)[c]) for c in range(3)]
    )
    covariance = effect.T @ effect
    total = float(np.trace(covariance))  # 0 where the finer simulation agrees exactly
    return DiscretisationError(shapes, covariance / total if total else covariance, load)


def _fields(xy: FloatArray, size: float) -> FloatArray:
    """Bumps of the width of an element on a grid, whose random sum is the field, (k, n_pix)."""
    low, high = xy.min(axis=0), xy.max(axis=0)
    counts = np.maximum(np.ceil((high - low) / size).astype(int), 1) + 1
    axes = [np.linspace(a, b, n) for a, b, n in zip(low, high, counts, strict=True)]
    centres = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    distance = np.linalg.norm(xy[None] - centres[:, None], axis=2)
    return np.asarray(np.exp(-0.5 * (distance / (0.7 * size)) ** 2))
