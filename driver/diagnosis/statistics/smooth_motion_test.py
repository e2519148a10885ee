"""Smooth motions of the face that grow with its stretch, whatever makes them.

What bends the images (a lens, a scan that is not straight) and most of what deforms a specimen
otherwise than its model moves the face smoothly, and the more the further it is stretched. No
cause of the library need be like it, and over all slow modes of all images it is lost in noise:
along these few directions it is not.
"""

from __future__ import annotations

import numpy as np

from driver.identification.data import Data
from meshes.arrays import FloatArray

DEGREE = 3


def smooth_fields(data: Data, motion: FloatArray) -> FloatArray:
    """Whitened effects of motions cubic in X and Y, each in proportion to the stretch.

    Args:
        data: the data.
        motion: of the face as simulated [µm], shape (T_all, n_pix, 3).

    Returns:
        u, v, w of nine monomials each (a constant is a rigid motion), on a scale of their own,
        shape (27, n).
    """
    xy = data.image.images.xy
    middle = xy.mean(axis=0)
    x, y = ((xy - middle) / np.abs(xy - middle).max(axis=0)).T
    stretch = motion[..., 1] @ (y - y.mean()) / len(y)
    powers = [(m, n) for m in range(DEGREE + 1) for n in range(DEGREE + 1 - m) if m + n]
    no_load, rows = np.zeros(len(motion)), []
    for m, n in powers:
        for component in range(3):
            moved = np.zeros_like(motion)
            moved[..., component] = np.outer(stretch, x**m * y**n)
            rows.append(data.change(moved, no_load))
    return np.stack(rows)
