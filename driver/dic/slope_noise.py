"""What noise leaves in the slopes of a reference, by which motion is seen."""

from __future__ import annotations

import numpy as np

from driver.common.splines.images import spline_images
from driver.dic.surface_images import SurfaceImages
from meshes.arrays import FloatArray

# Variance of the slope of a cubic spline at a sample, through white samples of unit variance: the
# mean over all frequencies of (3 sin ω/(2 + cos ω))².
SLOPE_GAIN = 9.0 * (2.0 / np.sqrt(3.0) - 1.0)


def squared_slopes(images: SurfaceImages) -> tuple[FloatArray, float]:
    """Mean squares of the slopes of the reference, and what of each is noise.

    Args:
        images: the reference, its noise σ and the number n of images in its mean.

    Returns:
        mean squares along X and Y over the region of interest [-], shape (2,), noise included;
        its part in each, `SLOPE_GAIN` σ²/(n pixel²).
    """
    spline = spline_images(images.reference_image[None], images.pixel, images.frames.origin)
    slopes = spline.gradient(0, images.xy[:, 0], images.xy[:, 1])
    noise = SLOPE_GAIN * (images.sigma / images.pixel) ** 2 / images.n_reference
    return np.mean(slopes**2, axis=0), float(noise)
