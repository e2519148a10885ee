"""Known motions in closed form, from rigid to those of the wavelength of the specimen."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from meshes.arrays import FloatArray

Kind = Literal["rigid", "affine", "out of plane", "wave"]

_SHIFTS = ((0.10, 0.30), (0.25, -0.45), (0.50, 0.75))  # px along X and Y, over the pixel's cell
_STRAINS = (0.005, 0.015)  # along Y; half of it across, with the sign of Poisson, and as shear
_RISE = 0.05  # µm
_WAVE_STRAIN = 0.01  # its largest strain
_BEND = 2.0  # difference of height that a tilt or a wave makes, over the rms of the relief: more
# than that comes in steps from image to image, each of which starts from the one before


@dataclass(frozen=True, eq=False)
class KnownMotion:
    """u = shift + gradient·(x, y) + Σ amplitude sin(k·(x, y) + phase), for u, v and w.

    Attributes:
        name: what it is.
        kind: its family.
        shift: [µm], shape (3,).
        gradient: along X and Y [-], shape (3, 2).
        waves: amplitude [µm] of each component, wave vector [1/µm] and phase of each wave.
    """

    name: str
    kind: Kind
    shift: FloatArray
    gradient: FloatArray
    waves: tuple[tuple[FloatArray, FloatArray, float], ...] = ()

    def __call__(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """u, v, w (n, 3) [µm] and their slopes (n, 3, 2) at points X, Y (n,) [µm]."""
        points = np.column_stack([x, y])
        value = self.shift + points @ self.gradient.T
        slopes = np.repeat(self.gradient[None], len(points), axis=0)
        for amplitude, vector, phase in self.waves:
            turns = points @ vector + phase
            value = value + np.outer(np.sin(turns), amplitude)
            slopes = slopes + np.cos(turns)[:, None, None] * np.outer(amplitude, vector)
        return value, slopes


def known_motions(
    pixel: float, length: float, width: float, relief: float
) -> tuple[KnownMotion, ...]:
    """Return the motions of the laboratory.

    Args:
        pixel: side of a pixel [µm].
        length: of the specimen along Y [µm].
        width: of the specimen along X [µm].
        relief: rms of the heights of the reference about their best plane [µm].
    """
    still, flat = np.zeros(3), np.zeros((3, 2))
    motions = [
        KnownMotion(f"shift {dx:g}, {dy:g} px", "rigid", pixel * np.array([dx, dy, 0.0]), flat)
        for dx, dy in _SHIFTS
    ]
    for strain in _STRAINS:
        gradient = strain * np.array([[-0.5, 0.25], [0.25, 1.0], [0.0, 0.0]])
        motions.append(KnownMotion(f"strain {strain:.1%}", "affine", still, gradient))
    rise, tilt, bend = still.copy(), flat.copy(), _BEND * relief
    rise[2], tilt[2, 1] = _RISE, bend / length
    motions.append(KnownMotion(f"rise {1e3 * _RISE:g} nm", "out of plane", rise, flat))
    motions.append(KnownMotion(f"tilt {1e3 * bend:.3g} nm", "out of plane", still, tilt))
    along, across = 2 * np.pi / length, 2 * np.pi / width
    for name, phase in (("sine", 0.0), ("cosine", np.pi / 2)):
        waves = (
            (np.array([0.0, _WAVE_STRAIN / along, bend / 2]), np.array([0.0, along]), phase),
            (np.array([_WAVE_STRAIN / across, 0.0, 0.0]), np.array([across, 0.0]), phase),
        )
        motions.append(KnownMotion(f"{name} of one wavelength", "wave", still, flat, waves))
    return tuple(motions)
