"""χ as the paper defines it, for display and comparison: each image weighed by 2γ_f².

The fit itself weighs with the covariance of the data (`driver.identification.data`). In the
paper's weighting noise alone leaves χ_f = √((1 + 1/n)/2), n repeats in the reference, and χ_F = 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from typing import TYPE_CHECKING

import numpy as np

from meshes.arrays import FloatArray

if TYPE_CHECKING:
    from driver.identification.data import Data


@dataclass(frozen=True)
class PaperChi:
    """The dimensionless residuals of tables 4 and 5 of the paper.

    Attributes:
        chi: of images and loads together, equation (4.1).
        chi_f: of the images, the mean over time of equation (2.1).
        chi_F: of the loads, equation (4.2).
    """

    chi: float
    chi_f: float
    chi_F: float


def paper_chi(data: Data, load: FloatArray, rho: FloatArray) -> PaperChi:
    """χ, χ_f and χ_F of a prediction.

    χ_f² = Σ_t Σ_Ω ρ²/(2γ_f² N_f N_t), χ_F² = ‖F_m − F_c‖²/(γ_F² N_t),
    χ² = (N_f χ_f² + χ_F²)/(1 + N_f), with N_f pixels in N_t images, γ_f from the repeats.

    Args:
        data: the measurements.
        load: predicted readings of all frames [µN], shape (T_all,).
        rho: residual of the images of the frames in use [µm], shape (T, n_pix).
    """
    n_pixels = rho.shape[1]
    gap = (data.load - load)[data.load_index]
    seen = rho[data.with_image] / data.image.images.sigma
    of_images = float(np.mean(seen**2)) / 2 if seen.size else 0.0
    of_loads = float(np.mean(gap**2)) / data.load_noise**2
    both = (n_pixels * of_images + of_loads) / (1 + n_pixels)
    return PaperChi(sqrt(both), sqrt(of_images), sqrt(of_loads))
