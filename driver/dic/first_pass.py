"""A first, stiff motion of every frame of a series, from one frame to the next."""

from __future__ import annotations

import numpy as np

from driver.dic.engine import COARSE
from driver.dic.jump import Trail
from driver.dic.kernels import binned
from driver.dic.surface_images import SurfaceImages
from driver.dic.system import System
from meshes.arrays import FloatArray


def first_pass(images: SurfaceImages, system: System) -> FloatArray:
    """Each frame from where one before it ended that was followed.

    Args:
        images: the series.
        system: stiff, weighed.

    Returns:
        Nodal values [µm], shape (T, n).
    """
    box = images.box()
    starts = np.zeros((images.n_frames, system.size))
    trail = Trail(system, binned(images.reference_image[box], 2), 2 * images.pixel)
    for t in range(images.n_frames):
        spline = images.frames.coefficients[t]
        small = binned(images.sampled(spline, box), 2)
        end = system.iterate(spline, trail.start(small, spline), COARSE)
        starts[t] = end.p
        # A frame that was not followed would lead astray all that come after it.
        if end.reason == "converged":
            trail.add(small, end.p)
    return starts
