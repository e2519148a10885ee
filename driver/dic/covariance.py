"""Covariance over the images of a number that is read from the measured motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from driver.common.splines.kernels import HORIZON, coefficients
from driver.dic.basis import PixelMotion
from driver.dic.interpolation_noise import noise_of_weights
from driver.dic.kernels import spread
from driver.dic.series import SurfaceMotion
from driver.dic.surface_images import SurfaceImages
from driver.dic.system import sensitivity
from meshes.arrays import BoolArray, FloatArray, IntArray

_MARGIN = 10  # px, over which the cardinal cubic spline falls to 2e-6
_BLOCK = 2**24  # numbers of all frames that are at work together
_PIXELS = 4096  # whose weights in all frames are at work together


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
    return np.array(
        [_covariance(PixelWeights.of(motion, row), motion, images) for row in functionals]
    )


def _covariance(weights: PixelWeights, motion: SurfaceMotion, images: SurfaceImages) -> FloatArray:
    """Return that of one functional, of these weights, shape (T, T)."""
    own = np.array([
        float(noise_of_weights(weights.at(k), images.rows, images.cols, motion.shared_noise))
        for k in range(weights.solved.shape[1])
    ])[weights.which]  # fmt: skip
    alike = weights.products()[np.ix_(weights.which, weights.which)]
    covariance = images.sigma**2 * (np.diag(own) + alike / images.n_reference)
    if images.sigma_flat:
        covariance += flat_covariance(motion, images, weights)
    return covariance


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


@dataclass(frozen=True, eq=False)
class PixelWeights:
    """The weights q_t of a functional at the pixels in every frame, 0 at pixels that it lacks.

    Frames that have every pixel share them.

    Attributes:
        seen: ∇f·ψ at each pixel, shape (n_pix, n).
        solved: A⁻¹ Lᵀ of a frame that has every pixel, and of those that lack some, (n, m).
        kept: pixels that these have, each of shape (n_pix,); by their column.
        which: column of each frame, shape (T,).
    """

    seen: csr_array
    solved: FloatArray
    kept: Mapping[int, BoolArray]
    which: IntArray

    @staticmethod
    def of(motion: SurfaceMotion, functional: FloatArray) -> PixelWeights:
        """Solve the equations of each frame.

        Args:
            motion: measured motion.
            functional: L [1], shape (n,).
        """
        seen = sensitivity(motion.system.pixels.slope, motion.basis_uv, motion.basis_w)
        solved, kept = [motion.system.solve(functional)], dict[int, BoolArray]()
        which = np.zeros(len(motion.compared), dtype=np.int64)
        for t in np.flatnonzero(~motion.compared.all(axis=1) & ~motion.lost).tolist():
            which[t] = len(solved)
            kept[len(solved)] = motion.compared[t]
            solved.append(motion.equations.of(motion.compared[t]).solve(functional))
        return PixelWeights(seen, np.column_stack(solved), kept, which)

    def at(self, column: int, pixels: IntArray | slice = slice(None)) -> FloatArray:
        """Return one of the different weights at some pixels, shape (n,)."""
        weights = np.asarray(self.seen[pixels] @ self.solved[:, column])
        return weights * self.kept[column][pixels] if column in self.kept else weights

    def products(self) -> FloatArray:
        """Σ q q' over the pixels of the different weights, shape (m, m)."""
        total = np.zeros((self.solved.shape[1],) * 2)
        for first in range(0, self.seen.shape[0], _PIXELS):
            some = slice(first, first + _PIXELS)
            weights = np.ascontiguousarray((self.seen[some] @ self.solved).T)
            for column, kept in self.kept.items():
                weights[column] *= kept[some]
            total += weights @ weights.T
        return total


def flat_covariance(
    motion: SurfaceMotion, images: SurfaceImages, weights: PixelWeights
) -> FloatArray:
    """Return part of the flat pattern's error, for the weights of a functional, [µm²], (T, T).

    The pixels of the camera are taken in bands of columns, as many as memory has room for in all
    frames: from one band to the next only what the spline filter remembers is done twice.
    """
    T, every = len(weights.which), np.arange(len(images.rows))
    place = np.column_stack([images.rows, images.cols]).astype(np.float64)
    least, most, reach = place.min(axis=0), place.max(axis=0), 0.0
    for t in range(T):
        shift = _shift(motion, images, motion.fields, t)
        least = np.minimum(least, (place + shift).min(axis=0))
        most = np.maximum(most, (place + shift).max(axis=0))
        reach = max(reach, float(np.abs(shift[:, 1]).max()))
    start = np.floor(least).astype(np.int64) - _MARGIN
    rows, cols = (np.ceil(most).astype(np.int64) + _MARGIN + 1 - start).tolist()
    # Beyond the border of the camera the images go on as in a mirror, and so does their error.
    mirrored = (
        np.abs((np.arange(m) + first + n - 1) % (2 * n - 2) - (n - 1)) if n > 1
        else np.zeros(m, dtype=np.int64)
        for m, first, n in zip((rows, cols), start.tolist(), images.shape, strict=True)
    )  # fmt: skip
    error = images.flat_error[np.ix_(*mirrored)]
    total = np.zeros((T, T))
    width = max(_BLOCK // (T * rows), 1)
    for left in range(0, cols, width):
        right = min(left + width, cols)
        # What the filter of the splines remembers of the pixels beside the band.
        window = max(left - HORIZON, 0), min(right + HORIZON, cols)
        inside = slice(left - window[0], right - window[0])
        at = place - start - (0, window[0])
        some = every[(at[:, 1] >= -reach) & (at[:, 1] <= window[1] - window[0] + reach)]
        at = at[some]
        within = (at[:, 1] >= 0) & (at[:, 1] < window[1] - window[0])
        still = tuple(at[within].astype(np.int64).T)
        fields, shape = motion.fields.at(some), (rows, window[1] - window[0])
        whole, effects = weights.at(0, some), np.empty((T, rows * (right - left)))
        for t, column in enumerate(weights.which.tolist()):
            q = weights.at(column, some) if column else whole
            moved = at + _shift(motion, images, fields, t)
            effect = -coefficients(spread(moved, q, shape))
            effect[still] += q[within]
            effects[t] = (effect * error[:, window[0] : window[1]])[:, inside].ravel()
        total += effects @ effects.T
    return total


def _shift(motion: SurfaceMotion, images: SurfaceImages, fields: PixelMotion, t: int) -> FloatArray:
    """Return u, v of a frame at pixels [px], none where it is lost, shape (n, 2)."""
    shift = fields[np.array([t])][0, :, :2] / images.pixel
    return np.zeros_like(shift) if motion.lost[t] else shift
