"""Frames that lack some of the pixels: their splines and their equations."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from driver.dic.system import MIN_USED, End, Pixels, System
from driver.experiment.images.heightmaps import on_surface
from meshes.arrays import BoolArray, FloatArray


def mark_gaps(coefficients: FloatArray, heights: FloatArray) -> None:
    """Set to NaN the spline coefficients of pixels without a height.

    Whatever would be interpolated from there is NaN. The coefficients beside them are those of the
    surface extended over the gap: two pixels off they err by 2 % of what that is wrong by.

    Args:
        coefficients: cubic B-spline coefficients of filled images [µm], written.
        heights: these images with their gaps, same shape.
    """
    coefficients[~on_surface(heights)] = np.nan


@dataclass(frozen=True, eq=False)
class Equations:
    """The normal equations of a series.

    Attributes:
        whole: of the frames that have every pixel, with penalties of u, v and of w, weighed.
        least_weight: of the penalty of w where a frame has no pixel, for a roughness as large as
            the relief: nothing beside a pixel.
    """

    whole: System
    least_weight: float

    def of(self, kept: BoolArray) -> System:
        """Return the equations of a frame.

        Args:
            kept: the pixels that it has, shape (n_pix,).
        """
        if kept.all():
            return self.whole
        return self._weighed(self._some(kept), self.whole.weights[0], self.least_weight)

    def without_penalty(self, kept: BoolArray) -> System:
        """Return the equations of a frame without the penalty of u and v.

        Args:
            kept: the pixels that it has, shape (n_pix,).
        """
        if not kept.all():
            return self._weighed(self._some(kept), 0.0, self.least_weight)
        whole = self.whole
        free = System(whole.pixels, whole.basis_uv, whole.basis_w, whole.parts)
        return self._weighed(free, 0.0, 0.0)

    def _some(self, kept: BoolArray) -> System:
        pixels = self.whole.pixels
        some = Pixels(
            pixels.rows[kept], pixels.cols[kept], pixels.height[kept],
            np.ascontiguousarray(pixels.slope[kept]), pixels.pixel,
        )  # fmt: skip
        return System(
            some,
            self.whole.basis_uv.at_pixels(kept),
            self.whole.basis_w.at_pixels(kept),
            self.whole.parts,
        )

    def _weighed(self, system: System, weight: float, least_w: float) -> System:
        system.weigh((weight, max(self.whole.weights[1], least_w)))
        return system

    def solve(
        self, image: FloatArray, start: FloatArray, tolerance: float, variance: float = 0.0
    ) -> End:
        """Return the motion of one frame by its own equations.

        Those of all pixels lead to the same motion, but slowly where many are lacking, and leave
        what lies in a gap where it started.

        Args:
            image: cubic B-spline coefficients [µm], NaN where nothing was measured.
            start: nodal values [µm], shape (n,).
            tolerance: largest nodal update of u, v at the end [px].
            variance: of ρ by noise [µm²], 0 where it is not known.
        """
        at_start = self.whole.compare(image, start)
        seen = np.isfinite(at_start.residual)
        if at_start.used == seen.size or at_start.used < MIN_USED * seen.size:
            end = self.whole.iterate(image, start, tolerance, at_start, variance)
        else:
            end = self.of(seen).iterate(image, start, tolerance, variance=variance)
            seen[seen] = end.steady
        restless = end.reason in ("slow", "converged") and end.last_update >= tolerance
        if restless and not end.steady.all():
            # Pixels at a border that come and go keep it from an end.
            kept = seen if end.steady.size < seen.size else end.steady
            if np.count_nonzero(kept) >= MIN_USED * kept.size:
                again = self.of(kept).iterate(image, end.p, tolerance, variance=variance)
                end = replace(again, iterations=end.iterations + again.iterations)
        if end.residual.size < seen.size:
            now = self.whole.compare(image, end.p)
            end = replace(end, residual=now.residual, right=now.right)
        return end
