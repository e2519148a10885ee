"""Covariance over the images of a number that is read from the measured motion."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from driver.dic.interpolation_noise import noise_of_weights
from driver.dic.series import SurfaceMotion, sensitivity
from driver.dic.surface_images import SurfaceImages
from meshes.arrays import FloatArray

_MARGIN = 10  # px, over which the cardinal cubic spline falls to 2e-6


def covariance_in_time(
    motion: SurfaceMotion, images: SurfaceImages, functionals: FloatArray
) -> FloatArray:
    """Covariance of L p_t, p_t the nodal values of frame t, between the frames.

    With q_t = J_t A_t⁻¹ Lᵀ, a weight at each pixel (J = ∇f·ψ over the pixels that frame t has,
    A_t = J_tᵀJ_t + P), an error δρ_t of the residual shifts L p_t by q_tᵀ δρ_t. Three errors enter:

    - the noise of frame t, its own:               σ² q_tᵀR q_t δ_tt', R the autocorrelation of
      noise that is read between the pixels, mean of the series (`interpolation_noise`);
    - the noise of the reference, shared by all:    σ² q_tᵀq_t' / n;
    - the error e of the flat pattern, which is fixed in the camera and stands in the reference as
      in the frames: δρ_t(x) = e(x) − e(x + u_t). Nothing is left of it without motion; it grows
      with the motion, that of the stage included, in proportion at first, to that of two
      independent images beyond the size of the dots. All frames share e, and frames that moved
      alike share its effect. With E_t the interpolation at x + u_t and d_t = (E_0 − E_t)ᵀ q_t,
      its covariance is Σ d_t d_t' s²/n_flats over the pixels of the camera, where e is
      independent from pixel to pixel with the standard error that the flats give it.

    What a penalty holds back is not in it: `held_back`. A frame that is lost has no measured
    motion; what is stated for it is what a frame without gaps and motion has.

    Args:
        motion: measured motion.
        images: the images behind it.
        functionals: k rows L [1], shape (k, n).

    Returns:
        [µm²], shape (k, T, T).
    """
    covariances = []
    for weights in pixel_weights(motion, functionals):
        own = noise_of_weights(weights, images.rows, images.cols, motion.shared_noise)
        covariance = images.sigma**2 * (np.diag(own) + weights @ weights.T / images.n_reference)
        if images.sigma_flat:
            covariance += flat_covariance(motion, images, weights)
        covariances.append(covariance)
    return np.array(covariances)


def held_back(motion: SurfaceMotion, images: SurfaceImages, functional: FloatArray) -> float:
    """Return the standard deviation of what the penalty takes from L p [µm].

    A motion p of the roughness that is granted, which is the prior N(0, σ²(1 + 1/n) P⁻¹), is
    measured as p − A⁻¹P p: the variance of L A⁻¹P p is σ²(1 + 1/n) L A⁻¹P A⁻¹ Lᵀ.

    Args:
        motion: measured motion.
        images: the images behind it.
        functional: L [1], shape (n,).
    """
    solved = motion.system.solve(functional)
    energy = float(solved @ motion.system.penalty_force(solved))
    variance = images.sigma**2 * (1.0 + 1.0 / images.n_reference)
    return float(np.sqrt(variance * max(energy, 0.0)))


def pixel_weights(motion: SurfaceMotion, functionals: FloatArray) -> FloatArray:
    """q_t of every frame, 0 at pixels that it lacks, for k rows L (k, n), shape (k, T, n_pix)."""
    whole, right = motion.system, np.ascontiguousarray(functionals.T)
    seen = sensitivity(whole.pixels.slope, motion.basis_uv, motion.basis_w)
    weights = np.repeat((seen @ whole.solve(right)).T[:, None], len(motion.compared), axis=1)
    for t in np.flatnonzero(~motion.compared.all(axis=1) & ~motion.lost):
        kept = motion.compared[t]
        weights[:, t] = (seen @ motion.equations.of(kept).solve(right)).T * kept
    return np.asarray(weights)


def flat_covariance(
    motion: SurfaceMotion, images: SurfaceImages, weights: FloatArray
) -> FloatArray:
    """Return part of the flat pattern's error, for weights q_t (T, n_pix), [µm²], shape (T, T)."""
    shift = np.where(motion.lost[:, None, None], 0.0, motion.at_pixels()[..., :2])
    moved = shift / images.pixel + np.column_stack([images.rows, images.cols])
    low = np.floor(moved.min(axis=(0, 1))).astype(np.int64) - _MARGIN
    low = np.minimum(low, [images.rows.min() - _MARGIN, images.cols.min() - _MARGIN])
    high = np.maximum(moved.max(axis=(0, 1)), [images.rows.max(), images.cols.max()])
    shape = tuple((np.ceil(high).astype(np.int64) + _MARGIN + 1 - low).tolist())
    rest = np.ravel_multi_index((images.rows - low[0], images.cols - low[1]), shape)
    # Beyond the border of the camera the images go on as in a mirror, and so does their error.
    inside = [np.arange(n) + start for n, start in zip(shape, low, strict=True)]
    mirrored = (
        np.abs((at + n - 1) % (2 * n - 2) - (n - 1)) if n > 1 else np.zeros_like(at)
        for at, n in zip(inside, images.shape, strict=True)
    )
    error = images.flat_error[np.ix_(*mirrored)].ravel()
    effects = np.empty((len(weights), error.size))
    for t, q in enumerate(weights):
        carried = _spread(moved[t] - low, q, shape)
        effects[t] = np.bincount(rest, q, error.size) - carried
    effects *= error
    return np.asarray(effects @ effects.T)


def _spread(at: FloatArray, values: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    """Return transpose of cubic B-spline interpolation at places (n, 2) [px], over all pixels."""
    first = np.floor(at).astype(np.int64)
    fraction = (at - first).T
    along = [_b_splines(part) for part in fraction]
    total = np.zeros(shape[0] * shape[1])
    for i in range(4):
        for j in range(4):
            index = (first[:, 0] - 1 + i) * shape[1] + first[:, 1] - 1 + j
            total += np.bincount(index, along[0][i] * along[1][j] * values, total.size)
    # Away from the border the filter from samples to coefficients is its own transpose.
    return np.asarray(ndimage.spline_filter(total.reshape(shape), order=3, mode="mirror")).ravel()


def _b_splines(t: FloatArray) -> FloatArray:
    """Return the four cubic B-splines at a fraction of a pixel, shape (4, n)."""
    s = 1.0 - t
    return np.array([s**3, 4 - 6 * t**2 + 3 * t**3, 4 - 6 * s**2 + 3 * s**3, t**3]) / 6
