"""What stands out of a height map by itself: dust, and readings that went astray."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from meshes.arrays import BoolArray, FloatArray

MEDIAN = 5  # px; a spike fills less than half of this window, a dot of the pattern fills it
# Robust standard deviations. The largest of a clean map: 4 to 5 on the platinum dots of a prism,
# 6.3 on synthetic dots without noise, 8.1 on 512² pixels of an AFM scan; of noise alone 5.5.
SPIKE = 10.0
REACH = 2  # px around a spike that its spline still feels
NORMAL = 1.4826  # standard deviation over median absolute deviation of normal numbers


def spread(values: FloatArray) -> float:
    """Return the standard deviation of a sample from its median absolute deviation."""
    return float(NORMAL * np.median(np.abs(values - np.median(values))))


def spikes(heights: FloatArray, region: BoolArray) -> BoolArray:
    """Pixels of a surface that stand out of the median of their neighbours.

    Args:
        heights: one height map without gaps [µm], shape (rows, cols).
        region: pixels to look at, shape (rows, cols).

    Returns:
        True at spikes in the region and the pixels around them, shape (rows, cols).
    """
    beyond = heights - ndimage.median_filter(heights, MEDIAN, mode="nearest")
    return _grown(_outside(beyond, region), region)


def strays(stack: FloatArray, region: BoolArray) -> BoolArray:
    """Pixels that one of several images of a surface shows where the others do not.

    Args:
        stack: registered images [µm], shape (n, rows, cols).
        region: pixels to look at, shape (rows, cols).

    Returns:
        True at strays in the region and the pixels around them, shape (rows, cols).
    """
    beyond = stack - np.median(stack, axis=0)
    beyond -= np.median(beyond[:, region], axis=1)[:, None, None]
    marked = np.any([_outside(of_image, region) for of_image in beyond], axis=0)
    return _grown(np.asarray(marked), region)


def _outside(beyond: FloatArray, region: BoolArray) -> BoolArray:
    inside = beyond[region]
    # Noise below a digital level leaves most pixels exactly at the median.
    scale = spread(inside) or float(inside.std())
    return np.asarray(region & (np.abs(beyond) > SPIKE * scale))


def _grown(found: BoolArray, region: BoolArray) -> BoolArray:
    grown = ndimage.binary_dilation(found, iterations=REACH) if found.any() else found
    return np.asarray(grown & region)
