"""What is left of the flat pattern: heights that stay in the camera frame while the stage moves.

The pattern P of the flats is subtracted from every image. Where it has changed since, images
carry a P(x) besides: the frame is read at x + u and the reference at x, so that the residual
f + w − g(x + u) gets −a (P(x + u) − P(x)), as if the specimen had risen by as much.
"""

from __future__ import annotations

import numpy as np

from driver.common.splines.images import spline_images
from driver.dic.surface_images import SurfaceImages
from meshes.arrays import FloatArray


def apparent_rise(images: SurfaceImages, motion: FloatArray) -> FloatArray | None:
    """P(x + u) − P(x) at the pixels [µm], shape (T, n_pix); None where no flats show P.

    Args:
        images: the series.
        motion: motion of specimen and stage at the pixels [µm], shape (T, n_pix, 3).
    """
    pattern = images.flat_pattern
    if pattern is None:
        return None
    spline = spline_images(pattern[None], images.pixel, images.frames.origin)
    moved = images.xy + motion[..., :2]
    there = spline.value(np.zeros(len(motion), dtype=int), moved[..., 0], moved[..., 1])
    return np.asarray(there - pattern[images.rows, images.cols])
