"""The equations of a frame that lacks some of the pixels."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from driver.dic.basis import Basis
from driver.dic.factor import Matrix
from driver.dic.system import MIN_USED, End, Pixels, System

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Equations:
    """The normal equations of a series.

    Attributes:
        whole: of the frames that have every pixel, weighed.
        bending: penalty of w, which holds it only where a frame has no pixel, shape (n, n).
        weight: of `bending`, for a roughness as large as the relief: nothing beside a pixel.
    """

    whole: System
    bending: Matrix
    weight: float

    def of(self, kept: BoolArray) -> System:
        """Return the equations of a frame.

        Args:
            kept: the pixels that it has, shape (n_pix,).
        """
        if kept.all():
            return self.whole
        pixels = self.whole.pixels
        some = Pixels(
            pixels.rows[kept], pixels.cols[kept], pixels.height[kept],
            np.ascontiguousarray(pixels.slope[kept]), pixels.pixel,
        )  # fmt: skip
        system = System(
            some,
            _part(self.whole.basis_uv, kept),
            _part(self.whole.basis_w, kept),
            (*self.whole.parts, self.bending),
        )
        system.weigh((*self.whole.weights, self.weight))
        return system

    def solve(self, image: FloatArray, start: FloatArray, tolerance: float) -> End:
        """Return the motion of one frame by its own equations.

        Those of all pixels lead to the same motion, but slowly where many are lacking, and leave
        what lies in a gap where it started.

        Args:
            image: cubic B-spline coefficients [µm], NaN where nothing was measured.
            start: nodal values [µm], shape (n,).
            tolerance: largest nodal update of u, v at the end [px].
        """
        kept = np.isfinite(self.whole.residual(image, start))
        if kept.all() or kept.mean() < MIN_USED:
            return self.whole.iterate(image, start, tolerance)
        end = self.of(kept).iterate(image, start, tolerance)
        return replace(end, residual=self.whole.residual(image, end.p))


def _part(basis: Basis, kept: BoolArray) -> Basis:
    return Basis(basis.mesh, basis.cell[kept], basis.shape[kept])
