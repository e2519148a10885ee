"""A first, stiff motion of every frame of a series, from one frame to the next."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from driver.common.splines.images import samples
from driver.dic.kernels import binned
from driver.dic.surface_images import SurfaceImages
from driver.dic.system import System
from driver.experiment.images.heightmaps import fill_off_surface
from driver.experiment.images.rigid import phase_correlation

FloatArray = NDArray[np.float64]

JUMP = 0.5  # px; a smaller shift between two frames is left to Gauss–Newton
TOLERANCE_FIRST = 2e-2  # px; enough to warp the images back


def first_pass(images: SurfaceImages, system: System) -> FloatArray:
    """Each frame from where the last one ended that was followed.

    Args:
        images: the series.
        system: stiff, weighed.

    Returns:
        Nodal values [µm], shape (T, n).
    """
    n = 2 * system.n_uv
    box = np.s_[
        images.rows.min() : images.rows.max() + 1, images.cols.min() : images.cols.max() + 1
    ]
    starts = np.zeros((images.n_frames, system.size))
    last, before = starts[0], binned(images.reference_image[box], 2)
    for t, spline in enumerate(images.frames.coefficients):
        seen = samples(spline)[box]
        after = binned(fill_off_surface(seen, np.isfinite(seen)), 2)
        shift = 2 * images.pixel * np.array(phase_correlation(before, after))
        p = last
        if np.hypot(*shift) > JUMP * images.pixel:
            moved = p + np.repeat([*shift, 0.0], [n // 2, n // 2, system.size - n])
            left = [float(np.nanstd(system.residual(spline, q))) for q in (p, moved)]
            p = moved if left[1] < left[0] else p
        end = system.iterate(spline, p, TOLERANCE_FIRST)
        starts[t] = end.p
        # A frame that was not followed would lead astray all that come after it.
        if end.reason == "converged":
            last, before = end.p, after
    return starts
