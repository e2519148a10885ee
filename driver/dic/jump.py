"""Where the motion of an image starts: from that of images before it, the stage's jump added."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import ndimage
from scipy.signal import fftconvolve

from driver.dic.system import System
from driver.experiment.images.rigid import phase_correlation, spectral_shift, spectrum
from meshes.arrays import ComplexArray, FloatArray

JUMP = 0.5  # px; a smaller shift between two images is left to Gauss–Newton
TURNS = 4.0  # degrees between the angles that are tried
_FLAT = 1e-6  # of the squares of an image, below which a part of it has no relief
REMEMBERED = 3  # images before, beside the reference: two in turn may show something else


@dataclass(frozen=True, eq=False)
class Seen:
    """An image that was followed: binned, and its nodal values (n,)."""

    image: FloatArray
    p: FloatArray

    @cached_property
    def spectrum(self) -> ComplexArray:
        """What the shift of later images is found from."""
        return spectrum(self.image)


class Trail:
    """The reference and the last images that were followed, from which the next one starts."""

    def __init__(self, system: System, reference: FloatArray, scale: float) -> None:
        """Begin at the reference.

        Args:
            system: equations of the images, weighed.
            reference: binned over a box around the pixels of the system.
            scale: size of one of its pixels in the unit of the nodal values.
        """
        self._system, self._scale = system, scale
        self._reference = Seen(reference, np.zeros(system.size))
        self._last = deque([self._reference], REMEMBERED)

    def add(self, image: FloatArray, p: FloatArray) -> None:
        """Remember an image that was followed, binned as the reference is."""
        self._last.append(Seen(image, p))

    def start(self, image: FloatArray, spline: FloatArray) -> FloatArray:
        """Return the motion of an image before, or that and the shift since, that leaves least.

        Args:
            image: binned as the reference is.
            spline: cubic B-spline coefficients of the image.
        """
        # Of several that leave as much, as those of a lost image do, the last one counts.
        best, least = self._last[-1].p, np.inf
        now, shape = spectrum(image), (image.shape[0], image.shape[1])
        tried = [*reversed(self._last)]
        if self._last[0] is not self._reference:
            tried.append(self._reference)
        for before in tried:
            shift = self._scale * np.array(spectral_shift(before.spectrum, now, shape))
            for p in self._from(before, shift):
                left = _left(self._system, spline, p)
                if left < least:
                    best, least = p, left
        return best

    def _from(self, before: Seen, shift: FloatArray) -> list[FloatArray]:
        if np.hypot(*shift) <= JUMP * self._system.pixels.pixel:
            return [before.p]
        n = self._system.n_uv
        jump = np.repeat([*shift, 0.0], [n, n, self._system.size - 2 * n])
        return [before.p, before.p + jump]


def far_shift(
    system: System, reference: FloatArray, image: FloatArray, box: tuple[slice, slice]
) -> FloatArray:
    """Return the shift at which the pixels of the system lie anywhere inside the image.

    Phase correlation over their box finds shifts below half of it; normalised cross-correlation
    with the whole image finds all that leave the box inside.

    Args:
        system: equations of the images, in pixels of the reference.
        reference: heights without gaps, shape (rows, cols).
        image: the same of the image.
        box: rows and columns around the pixels of the system.
    """
    patch = reference[box] - reference[box].mean()
    seen = image - image.mean()
    ones = np.ones(patch.shape)
    total, squares = (fftconvolve(part, ones, mode="valid") for part in (seen, seen**2))
    spread = np.maximum(squares - total**2 / patch.size, _FLAT * float(np.sum(seen**2)))
    alike = fftconvolve(seen, patch[::-1, ::-1], mode="valid") / np.sqrt(spread)
    at = np.unravel_index(int(alike.argmax()), alike.shape)
    u, v = (int(place) - part.start for place, part in zip(at, box, strict=True))
    n = system.n_uv
    return np.repeat(np.array([u, v, 0.0], dtype=np.float64), [n, n, system.size - 2 * n])


def best_turn(
    system: System,
    reference: FloatArray,
    image: FloatArray,
    box: tuple[slice, slice],
    spline: FloatArray,
) -> FloatArray:
    """Return the rigid motion in the plane that leaves least, of turns by all angles.

    Shifts beyond half of the box are not tried with a turn.

    Args:
        system: equations of the images, in pixels of the reference.
        reference: heights without gaps, shape (rows, cols).
        image: the same of the image.
        box: rows and columns around the pixels of the system.
        spline: cubic B-spline coefficients of the image.
    """
    places = system.basis_uv.nodes
    middle = np.array([0.5 * (part.start + part.stop - 1) for part in box])
    best, least = np.zeros(system.size), np.inf
    for angle in np.radians(np.arange(0.0, 360.0, TURNS)):
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        # What lies at x in the turned reference is at Rᵀ(x − m) + m in itself.
        turned = ndimage.affine_transform(
            reference, turn.T, middle - turn.T @ middle, order=1, mode="nearest"
        )
        shift = np.array(phase_correlation(turned[box], image[box]))
        moved = (places - middle) @ (turn - np.eye(2)).T + shift
        p = np.concatenate([moved[:, 0], moved[:, 1], np.zeros(system.size - 2 * system.n_uv)])
        left = _left(system, spline, p)
        if left < least:
            best, least = p, left
    return best


def _left(system: System, spline: FloatArray, p: FloatArray) -> float:
    """Return the standard deviation of ρ, infinite where most pixels have left the image."""
    residual = system.residual(spline, p)
    seen = residual[np.isfinite(residual)]
    return float(np.std(seen)) if 2 * seen.size > residual.size else np.inf
