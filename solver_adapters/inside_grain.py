"""Critical stress inside a grain: smooth modes and a band (docs/method/law.md).

Every function takes complex numbers, whose imaginary part carries a derivative.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from meshes.arrays import AnyArray


def standardised(coordinate: AnyArray, volume: AnyArray) -> AnyArray:
    """Distance from the mean over √3 standard deviations, −1 to 1 in a uniform bar.

    Args:
        coordinate: of the points of a grain [µm], (n_points,).
        volume: of each point [µm³], (n_points,).
    """
    off = coordinate - (volume @ coordinate) / volume.sum()
    return np.asarray(off / np.sqrt(3.0 * (volume @ off**2) / volume.sum()))


def mode_factor(modes: Sequence[Any], eta: AnyArray, xi: AnyArray) -> AnyArray:
    """Factor on τ0 at the points of a grain, see `Material.tau0_grain1_slope_Y`.

    The bend is the second Legendre polynomial: in a uniform bar the modes are orthogonal.

    Args:
        modes: slope along Y, bend along Y, slope along X of ln τ0.
        eta: where the points lie along Y, `standardised`, (n_points,).
        xi: where they lie along X, likewise.
    """
    slope_y, bend_y, slope_x = modes
    exponent = slope_y * eta + bend_y * 0.5 * (3.0 * eta**2 - 1.0) + slope_x * xi
    return np.asarray(np.exp(exponent))


def band_factor(band: Sequence[Any], eta: AnyArray) -> AnyArray:
    """Factor on τ0 at the points of a grain, see `Material.tau0_grain1_band`.

    Args:
        band: ln τ0 in its middle, where that is along the grain, half of its width.
        eta: where the points lie along Y, `standardised`, (n_points,).
    """
    height, middle, half_width = band
    return np.asarray(np.exp(height * 0.5 ** (((eta - middle) / half_width) ** 4)))
