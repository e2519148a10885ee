"""How large an image shows the relief of the reference: the gain of its heights."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse.linalg import lsmr

from driver.dic.basis import Basis
from driver.dic.system import Pixels, System, sensitivity
from meshes.arrays import BoolArray, FloatArray

_SURE = 5.0  # σ of a gain beyond which it is another one
_MATTERS = 0.01  # from 1; less bends no motion by what noise shows


@dataclass(frozen=True, eq=False)
class Gains:
    """Heights of each image over those of the reference, of relief finer than elements of w.

    Attributes:
        value: shape (T,), NaN of an image that is unlike the others.
        sigma: standard deviation by noise, infinite where the reference has no such relief.
    """

    value: FloatArray
    sigma: float

    def off(self, known: FloatArray) -> BoolArray:
        """Images whose gain is surely another one than is known, by what matters, shape (T,)."""
        change = np.abs(np.nan_to_num(self.value, nan=1.0) - known)
        change[np.isnan(self.value)] = 0.0
        return np.asarray(change > max(_SURE * self.sigma, _MATTERS))


def fine_relief(pixels: Pixels, basis_w: Basis) -> FloatArray:
    """Return what of f no function of w shows [µm], shape (n_pix,)."""
    relief = pixels.height - pixels.height.mean()
    coarse = lsmr(basis_w.values, relief, atol=1e-8, btol=1e-8)[0]
    return np.asarray(relief - basis_w.values @ coarse)


def gains(
    system: System, fine: FloatArray, along: FloatArray, known: FloatArray, noise: tuple[float, int]
) -> Gains:
    """Estimate the gain a of each image from what the image leaves along the fine relief c.

    A gain is one more unknown beside the motion p, whose sensitivity is c. Least squares with
    A p = b solved, and ρ of the gain a₀, give a − a₀ = −c·ρ/(c·c⊥), c⊥ = c − J A⁻¹ Jᵀ c. The noise
    of the reference is in c as in ρ: σ²/n at each of n_pix − tr(A⁻¹M) degrees of freedom is taken
    from both products.

    Args:
        system: weighed, J its sensitivity.
        fine: c [µm], shape (n_pix,).
        along: c·ρ of each image [µm²], NaN of one that is unlike the others, shape (T,).
        known: a₀, shape (T,).
        noise: σ of one image [µm], and number n of images in the reference.
    """
    sigma, n_reference = noise
    pixels = system.pixels
    seen = sensitivity(pixels.slope, system.basis_uv, system.basis_w)
    left = fine - seen @ system.solve(np.asarray(seen.T @ fine))
    of_noise = sigma**2 / n_reference * (len(fine) - system.freedom())
    sight = float(fine @ left) - of_noise
    if sight <= of_noise:  # relief that noise hides
        return Gains(known.copy(), np.inf)
    value = known - (along - of_noise) / sight
    return Gains(value, sigma * float(np.sqrt((1.0 + 1.0 / n_reference) / sight)))
