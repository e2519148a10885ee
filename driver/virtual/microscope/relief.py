"""The relief of an undeformed face: a closed formula of the material point, never a picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from meshes.arrays import FloatArray

Bounds = tuple[float, float, float, float]

_N_WAVES = 40


@dataclass(frozen=True, eq=False)
class Waves:
    """A random pattern of unit rms: a sum of plane waves, band-limited by construction.

    Attributes:
        vectors: wave vectors [1/µm], shape (n, 2).
        phases: shape (n,).
    """

    vectors: FloatArray
    phases: FloatArray

    @staticmethod
    def random(rng: np.random.Generator, shortest: float, longest: float) -> Waves:
        """Waves of any direction with lengths in a band [µm]."""
        number = 2 * np.pi / rng.uniform(shortest, longest, _N_WAVES)
        angle, phases = rng.uniform(0, 2 * np.pi, (2, _N_WAVES))
        return Waves(number[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]), phases)

    def __call__(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Values at positions [µm] of any shape."""
        total = np.zeros(np.broadcast_shapes(x.shape, y.shape))
        for (kx, ky), phase in zip(self.vectors, self.phases, strict=True):
            total += np.cos(kx * x + ky * y + phase)
        return np.asarray(total * np.sqrt(2 / len(self.phases)))


@dataclass(frozen=True, eq=False)
class Relief:
    """Heights of the undeformed face: dots on a polished surface.

    Attributes:
        dots: centres of the dots [µm], shape (n, 2).
        dot_height: of a dot [µm].
        dot_radius: of the foot of a dot [µm].
        roughness: rms of the polish [µm].
        waves: the pattern of the polish.
    """

    dots: FloatArray
    dot_height: float
    dot_radius: float
    roughness: float
    waves: Waves

    @staticmethod
    def random(
        rng: np.random.Generator,
        bounds: Bounds,
        dot_height: float,
        dot_radius: float,
        density: float,
        roughness: float,
    ) -> Relief:
        """Dots at random places inside bounds (x0, x1, y0, y1) [µm].

        Args:
            rng: source of the places and of the polish.
            bounds: where dots may be.
            dot_height: [µm].
            dot_radius: [µm].
            density: dots for each µm².
            roughness: rms of the polish [µm].
        """
        x0, x1, y0, y1 = bounds
        number = round(density * (x1 - x0) * (y1 - y0))
        dots = rng.uniform((x0, y0), (x1, y1), (number, 2))
        return Relief(dots, dot_height, dot_radius, roughness, Waves.random(rng, 0.8, 4.0))

    def __call__(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Heights [µm] at material points X, Y [µm] of any shape.

        A dot is h (1 − r²/R²)², a cap with a rounded foot: what a lens makes of a hemisphere.
        """
        height = self.roughness * self.waves(x, y)
        if len(self.dots):
            places = KDTree(np.column_stack([x.ravel(), y.ravel()]))
            near = places.sparse_distance_matrix(
                KDTree(self.dots), self.dot_radius, output_type="ndarray"
            )
            caps = self.dot_height * (1.0 - (near["v"] / self.dot_radius) ** 2) ** 2
            height += np.bincount(near["i"], caps, minlength=x.size).reshape(x.shape)
        return height
