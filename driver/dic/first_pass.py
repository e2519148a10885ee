"""A first, stiff motion of every frame of a series, from one frame to the next."""

from __future__ import annotations

import numpy as np

from driver.dic.engine import COARSE
from driver.dic.jump import after_jump
from driver.dic.kernels import binned
from driver.dic.surface_images import SurfaceImages
from driver.dic.system import System
from driver.experiment.images.rigid import phase_correlation
from meshes.arrays import FloatArray


def first_pass(images: SurfaceImages, system: System) -> FloatArray:
    """Each frame from where the last one ended that was followed.

    Args:
        images: the series.
        system: stiff, weighed.

    Returns:
        Nodal values [µm], shape (T, n).
    """
    box = images.box()
    starts = np.zeros((images.n_frames, system.size))
    last, before = starts[0], binned(images.reference_image[box], 2)
    for t in range(images.n_frames):
        spline = images.frames.coefficients[t]
        after = binned(images.sampled(spline, box), 2)
        shift = 2 * images.pixel * np.array(phase_correlation(before, after))
        end = system.iterate(spline, after_jump(system, spline, last, shift), COARSE)
        starts[t] = end.p
        # A frame that was not followed would lead astray all that come after it.
        if end.reason == "converged":
            last, before = end.p, after
    return starts
