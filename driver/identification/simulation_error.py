"""Covariance of what mesh and time steps leave wrong in a prediction.

The finer-minus-working difference is added to every prediction (defect correction). What the
finer simulation itself leaves wrong is not known, but how large it is and when it occurs is: the
root mean square falls with the first power of the size h (measured on two grains with meshes of
262, 574 and 1414 cells: slip concentrates where meshes differ), so that of the finer mesh is
κ = r/(1 − r) times that difference, r = h_fine/h_working. In time it follows the difference; in
space it is taken as a Gaussian field over the face, as rough as the finer elements and with the
mean square of the difference in each of u, v, w. The loads get the pattern of their own
difference, at amplitude κ.

Time steps of first order (backward Euler) err in a way of their own, with the halves of the steps
that were taken in place of a mesh half as large: what their correction leaves is known in shape and
size (`step_error`), and counts beside that of the mesh.

Images resolve fractions of a nanometre where a mesh error lasts for a whole test. Without this
term every cause that resembles a mesh error would be found significant.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from driver.identification.image_data import ImageData

FloatArray = NDArray[np.float64]

_SHAPES = 3  # shapes in time that are kept: onset of yield, growth, what unloading changes


@dataclass(frozen=True, eq=False)
class SimulationError:
    """Σ = I + (shapes shapesᵀ) ⊗ field for the images, I + loadᵀ load for the loads.

    Attributes:
        shapes: shapes in time times their amplitudes, κ included, frames first, shape (T, m).
        field: covariance over the whitened numbers of one image, trace 1, shape (n_z, n_z).
        load: patterns of the load error, κ included [µN], shape (k, T).
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

    def whiten_loads(self, load: FloatArray, patterns: FloatArray) -> FloatArray:
        """Σ^(−1/2) on (..., T), with the patterns of these frames (k, T) whitened alike."""
        _, amplitude, modes = np.linalg.svd(patterns, full_matrices=False)
        gain = 1.0 / np.sqrt(1.0 + amplitude**2) - 1.0
        return np.asarray(load + ((load @ modes.T) * gain) @ modes)


def simulation_error(
    image: ImageData,
    mesh: tuple[FloatArray, FloatArray],
    steps: tuple[FloatArray, FloatArray],
    size: float,
    ratio: float,
) -> SimulationError:
    """Covariance of the remaining error.

    Args:
        image: the image part of the data.
        mesh: finer minus working motion at the pixels [µm], shape (T, n_pix, 3), and load [µN],
            shape (T,), as far as they are of the mesh.
        steps: motion and load that the steps of the finer simulation leave wrong, alike.
        size: element size of the finer mesh [µm].
        ratio: element size of the finer over that of the working mesh.
    """
    kappa = share_left(ratio)
    shapes = np.hstack([kappa * _shapes(image, mesh[0]), _shapes(image, steps[0])])
    features = _fields(image.images.xy, size)
    spread = np.sqrt(np.mean((kappa * mesh[0]) ** 2 + steps[0] ** 2, axis=(0, 1)))
    effect = np.concatenate(
        [image.pixel_sensitivity(spread[c] * features[:, :, None] * np.eye(3)[c]) for c in range(3)]
    )
    covariance = effect.T @ effect
    total = float(np.trace(covariance))  # 0 where the finer simulation agrees exactly
    return SimulationError(
        shapes, covariance / total if total else covariance, np.stack([kappa * mesh[1], steps[1]])
    )


def _shapes(image: ImageData, motion: FloatArray) -> FloatArray:
    """Shapes in time times their amplitudes of a motion (T, n_pix, 3), shape (T, m)."""
    left, amplitude, _ = np.linalg.svd(image.pixel_sensitivity(motion), full_matrices=False)
    return np.asarray(left[:, :_SHAPES] * amplitude[:_SHAPES])


def share_left(ratio: float) -> float:
    """κ: what the finer simulation leaves wrong over finer minus working, first order in h.

    Args:
        ratio: element size of the finer over that of the working mesh.
    """
    return ratio / (1.0 - ratio)


def _fields(xy: FloatArray, size: float) -> FloatArray:
    """Bumps of the width of an element on a grid, whose random sum is the field, (k, n_pix)."""
    low, high = xy.min(axis=0), xy.max(axis=0)
    counts = np.maximum(np.ceil((high - low) / size).astype(int), 1) + 1
    axes = [np.linspace(a, b, n) for a, b, n in zip(low, high, counts, strict=True)]
    centres = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    distance = np.linalg.norm(xy[None] - centres[:, None], axis=2)
    return np.asarray(np.exp(-0.5 * (distance / (0.7 * size)) ** 2))
