"""The instrument: where its pixels look, its fixed pattern, its noise and its levels."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from meshes.arrays import FloatArray

Scene = Callable[[FloatArray, FloatArray], FloatArray]
"""Heights [µm] at places X, Y [µm] of the image; NaN where the surface is out of range."""

Bits = Literal[8, 16, 32]
_GROUND = 100 / 256  # mean height of the face, as a share of the range of 8 or 16 bits


@dataclass(frozen=True, eq=False)
class Camera:
    """A height-measuring microscope, at rest.

    Attributes:
        x: X at which each pixel looks with the stage at rest [µm], shape (rows, columns).
        y: Y, same shape.
        pixel: side of a pixel [µm].
        pattern: error that is fixed in the camera frame [µm], shape (rows, columns).
        noise: standard deviation of the height noise of each pixel [µm], shape (rows, columns).
        bits: of a level: unsigned integers of 8 or 16, floats of 32.
        level: height of a level [µm].
        samples: Gauss points along each side of a pixel over whose area it averages; 1 for the
            height at its centre.
    """

    x: FloatArray
    y: FloatArray
    pixel: float
    pattern: FloatArray
    noise: FloatArray
    bits: Bits
    level: float
    samples: int = 1

    def heights(self, scene: Scene, shift: FloatArray) -> FloatArray:
        """Heights without any error [µm], shape (rows, columns).

        Args:
            scene: what there is.
            shift: motion of the stage along X and Y [µm], shape (2,).
        """
        places, weights = np.polynomial.legendre.leggauss(self.samples)
        places, weights = places * self.pixel / 2, weights / 2
        x, y = self.x - shift[0], self.y - shift[1]
        return np.asarray(
            sum(
                a * b * scene(x + dx, y + dy)
                for dx, a in zip(places, weights, strict=True)
                for dy, b in zip(places, weights, strict=True)
            )
        )

    def photograph(
        self, rng: np.random.Generator, scene: Scene | None, shift: FloatArray
    ) -> NDArray[np.generic]:
        """Return an image in levels, shape (rows, columns).

        Args:
            rng: source of the noise.
            scene: what there is; None for a flat surface.
            shift: motion of the stage along X, Y and Z [µm], shape (3,).

        Raises:
            ValueError: heights beyond the range of the levels.
        """
        clean = np.zeros_like(self.x) if scene is None else self.heights(scene, shift[:2])
        height = clean + shift[2] + self.pattern + self.noise * rng.normal(size=clean.shape)
        if self.bits == 32:
            return np.asarray((height / self.level).astype(np.float32))
        top = 2**self.bits - 1
        levels = np.round(height / self.level + round(_GROUND * (top + 1)))
        on_surface = np.isfinite(levels)
        # Level 0 means that there is no height: a pixel that reads it would be lost in silence.
        if np.any(levels[on_surface] < 1) or np.any(levels[on_surface] > top):
            low, high = levels[on_surface].min(), levels[on_surface].max()
            raise ValueError(
                f"levels: found heights from level {low:.0f} to {high:.0f}, expected 1 to {top}, "
                f"the range of {self.bits} bits: take a coarser level or more bits"
            )
        kind = np.uint8 if self.bits == 8 else np.uint16
        return np.where(on_surface, levels, 0).astype(kind)
