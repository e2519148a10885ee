"""What noise alone leaves in the residual of an image, and the residual in units of it."""

from __future__ import annotations

import numpy as np

from driver.common.splines.images import variance_gain
from driver.experiment.images.flatfield import left_over
from meshes.arrays import FloatArray


def residual_variance(
    at: FloatArray, shift: FloatArray, sigma: float, n_reference: float, sigma_flat: float
) -> FloatArray:
    """Variance of ρ from noise alone [µm²], shape (..., n_pix).

    σ² (gain + 1/n): interpolation between pixels lowers the noise of a frame by a known
    gain, and the reference adds that of its mean of n images. The error of the flat pattern
    adds what it does not do to both images alike.

    Args:
        at: rows and columns of the pixels in the reference [px], shape (n_pix, 2).
        shift: u, v [px], shape (..., n_pix, 2).
        sigma: noise of one frame at a pixel [µm].
        n_reference: images averaged into the reference.
        sigma_flat: standard error of the flat pattern [µm].
    """
    moved = at + shift
    gain = variance_gain(moved[..., 0], moved[..., 1])
    variance = sigma**2 * (gain + 1.0 / n_reference)
    if sigma_flat:
        variance += sigma_flat**2 * left_over(shift, gain)
    return np.asarray(variance)


def residual_chi(
    residual: FloatArray, variance: FloatArray, n_parameters: float | FloatArray
) -> FloatArray:
    """Residual of each frame in units of noise; 1 if only noise is left, shape (T,).

    χ² = Σ ρ²/E[ρ²] / (n_pix − n_parameters), over the pixels that the frame has.

    Args:
        residual: ρ [µm], NaN at pixels that the frame lacks, shape (T, n_pix).
        variance: E[ρ²] of `residual_variance`, shape (T, n_pix).
        n_parameters: degrees of freedom of the motion that were fitted, of all frames or (T,).
    """
    squares = residual**2 / variance
    freedom = np.maximum(np.isfinite(squares).sum(axis=1) - n_parameters, 1.0)
    return np.asarray(np.sqrt(np.nansum(squares, axis=1) / freedom))
