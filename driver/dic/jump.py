"""Whether the stage jumped between two images."""

from __future__ import annotations

import numpy as np

from driver.dic.system import System
from meshes.arrays import FloatArray

JUMP = 0.5  # px; a smaller shift between two images is left to Gauss–Newton


def after_jump(system: System, spline: FloatArray, p: FloatArray, shift: FloatArray) -> FloatArray:
    """Return the motion of the image before, or that and a shift, whichever leaves less.

    Args:
        system: equations of the images.
        spline: cubic B-spline coefficients of the image.
        p: nodal values of the image before it, (n,).
        shift: between both, in the unit of p, (2,).
    """
    if np.hypot(*shift) <= JUMP * system.pixels.pixel:
        return p
    n = system.n_uv
    moved = p + np.repeat([*shift, 0.0], [n, n, system.size - 2 * n])
    left = [float(np.nanstd(system.residual(spline, q))) for q in (p, moved)]
    return moved if left[1] < left[0] else p
