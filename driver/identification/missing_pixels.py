"""The pixels that a frame lacks: one set for each, wherever a prediction moves them."""

from __future__ import annotations

import numpy as np

from driver.dic.surface_images import SurfaceImages
from meshes.arrays import BoolArray, FloatArray

REACH = 0.5  # px about its measured place within which a pixel must have a height


def lacking_pixels(images: SurfaceImages, motion: FloatArray) -> BoolArray | None:
    """Which pixels say nothing in which frame.

    A set that hung on the prediction would change by whole pixels as parameters change, and the
    misfit would jump.

    Args:
        images: the series.
        motion: measured motion at the pixels [µm], shape (T, n_pix, 3).

    Returns:
        Shape (T, n_pix), None where no frame lacks any.
    """
    reach = REACH * images.pixel
    corners = [np.array([x, y, 0.0]) for x in (-reach, reach) for y in (-reach, reach)]
    missing = np.zeros(motion.shape[:2], dtype=bool)
    for t, field in enumerate(motion):
        for corner in corners:
            missing[t] |= np.isnan(images.residual((field + corner)[None], np.array([t]))[0])
    return missing if missing.any() else None
