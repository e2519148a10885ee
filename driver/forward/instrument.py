"""What the instruments make of motion and force: gains, offsets and drifts, null when perfect.

The force that they are given is that of the instant at which the load was read, `load_lag` after
the image (`driver.forward.load_lag`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from driver.parameters.user_terms import ReadingTerm
from meshes.arrays import FloatArray

_TINY = 1e-30  # complex step


@dataclass(frozen=True, eq=False)
class Instrument:
    """Where and when the instruments looked.

    Attributes:
        xy: positions on the surface [µm], shape (n, 2).
        progress: time of each image over the duration of the test, 0 to 1, shape (T,).
        centre: X, Y about which the field is magnified, sheared and tilted [µm].
        terms: what installed packages add to the reading.
    """

    xy: FloatArray
    progress: FloatArray
    centre: tuple[float, float]
    terms: tuple[ReadingTerm, ...] = ()

    def reading(self, force: FloatArray, values: Mapping[str, float]) -> FloatArray:
        """Load that is read [µN] when the specimen carries `force`, shape (T,)."""
        return np.asarray(self._read(force, values), dtype=np.float64)

    def reading_rate(
        self, force: FloatArray, change: FloatArray, values: Mapping[str, float]
    ) -> FloatArray:
        """Return ∂reading for a change of the force, each of shape (T,) (complex step)."""
        if not self.terms:
            return np.asarray((1 + values["load_gain"]) * change)
        stepped = self._read(force + 1j * _TINY * change, values)
        return np.asarray(stepped.imag / _TINY)

    def _read(self, force: NDArray[np.inexact], values: Mapping[str, float]) -> Any:
        read = (
            (1 + values["load_gain"]) * force
            + values["load_offset"]
            + values["load_drift"] * self.progress
        )
        for term in self.terms:
            read = read + values[term.parameter.name] * term.load(force, self.progress)
        return read

    def appearance(self, motion: FloatArray, values: Mapping[str, float]) -> FloatArray:
        """Motion that the images show [µm], shape (T, n, 3)."""
        seen = motion.copy()
        seen[..., 2] *= 1 + values["height_scale"]
        for name in ("height_drift", "magnification_drift", "scan_shear_drift", "tilt_drift"):
            if values[name] != 0.0:
                seen += values[name] * self._pattern(name)
        return seen

    def reading_derivative(
        self, name: str, force: FloatArray, rate: FloatArray, values: Mapping[str, float]
    ) -> FloatArray:
        """∂reading/∂(load parameter), shape (T,).

        Args:
            name: of the parameter.
            force: that the specimen carries when the load is read [µN], shape (T,).
            rate: ∂force/∂time then [µN/s], shape (T,).
            values: every parameter.
        """
        if name == "load_gain":
            return force
        if name == "load_lag":
            return self.reading_rate(force, rate, values)
        for term in self.terms:
            if name == term.parameter.name:
                return np.asarray(term.load(force, self.progress), dtype=np.float64)
        return np.ones_like(force) if name == "load_offset" else self.progress

    def appearance_derivative(self, name: str, motion: FloatArray) -> FloatArray:
        """∂appearance/∂(image parameter)."""
        if name == "height_scale":
            change = np.zeros_like(motion)
            change[..., 2] = motion[..., 2]
            return change
        return self._pattern(name)

    def _pattern(self, name: str) -> FloatArray:
        """Apparent motion at unit drift, growing with time."""
        offset = self.xy - np.array(self.centre)
        field = np.zeros((len(self.xy), 3))
        if name == "magnification_drift":
            field[:, :2] = offset
        elif name == "scan_shear_drift":
            field[:, 0] = offset[:, 1]
        elif name == "height_drift":
            field[:, 2] = 1.0
        else:
            field[:, 2] = offset[:, 0]
        return np.asarray(self.progress[:, None, None] * field)
