"""A height noise that is stated for want of repeats: what that costs, and whether images agree."""

from __future__ import annotations

import numpy as np

from meshes.arrays import FloatArray

CONTRADICTS = 1.5  # ratio of two noises beyond which one of them is in doubt
COST = (
    "image 0 is the reference with the noise of one image, which all motions share: its own image "
    "tells nothing; the noise of a pixel, all χ and σ of the images hang on what is stated; a "
    "drift of the stage before loading, dust that moves and another height scale are not seen"
)


def contradiction(stated: float, seen: float, chi: FloatArray) -> str:
    """Say that the residuals of free correlation contradict a stated noise, if they do.

    Args:
        stated: noise of an image at a pixel [µm].
        seen: the same by the residuals from one image to the next [µm], NaN where they are too
            few.
        chi: residual of each image in units of the stated noise.
    """
    left = float(np.sqrt(np.mean(chi**2)))
    noise = stated * left if np.isnan(seen) else seen
    if 1 / CONTRADICTS < noise / stated < CONTRADICTS:
        return ""
    return (
        f"images.noise_nm: found {1e3 * stated:g}, but free correlation leaves χ {left:.2g}, and "
        f"its residuals scatter as a noise of {1e3 * noise:.3g} nm does: state that, or give "
        "images.repeats"
    )
