"""Smoothing of a measured motion along stage travel, and what it does to the covariance."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from driver.dic.series import SurfaceMotion
from driver.dic.surface_images import SurfaceImages
from driver.experiment.images.heightmaps import ImageError
from meshes.arrays import BoolArray, FloatArray, IntArray

_UNHEARD = 1e-6  # weight of a frame that is left out: less than any other, enough to stand alone


@dataclass(frozen=True, eq=False)
class Smoothed:
    """Nodal values smoothed from image to image.

    Attributes:
        coefficients: S p, shape (T, n).
        smoother: S, the same for every nodal value, shape (T, T). A motion that is piecewise
            linear in travel passes unchanged.
        covariance_in_time: S (I + 11ᵀ/n_reference) Sᵀ, shape (T, T): the covariance of value i
            in image t and value j in image t' is covariance_one[i, j] times its entry t, t'.
    """

    coefficients: FloatArray
    smoother: FloatArray
    covariance_in_time: FloatArray


def smooth_along_travel(
    coefficients: FloatArray,
    travel: FloatArray,
    length: float,
    n_reference: int,
    turning_points: IntArray | None = None,
    kept: BoolArray | None = None,
) -> Smoothed:
    """Penalise the change of slope against stage travel between two turning points.

    S = (W + DᵀD)⁻¹ W with D the second divided differences of neighbouring images times length²,
    none of them across a turning point, and W = I but for images that are left out, which follow
    the others. What oscillates over 2π·length of travel is halved; the noise of one image falls
    by the diagonal of S Sᵀ, and neighbours become correlated.

    Args:
        coefficients: nodal values of each image, shape (T, n).
        travel: of the stage at each image [µm], shape (T,); two images at one place are only
            allowed at a turning point.
        length: of travel [µm] below which changes count as noise.
        n_reference: number of images averaged into the reference.
        turning_points: images at which the loading turns; where the travel turns or rests if None.
        kept: images that count, shape (T,); all if None.

    Raises:
        ImageError: sizes that differ, a length that is not positive, or an image without travel
            that is no turning point.
    """
    n = len(coefficients)
    if travel.shape != (n,):
        raise ImageError(f"travel of shape {travel.shape}, but there are {n} images.")
    if not (np.isfinite(length) and length > 0):
        raise ImageError(f"length = {length} µm; a positive stage travel is expected.")
    steps = np.diff(travel)
    if turning_points is None:
        # A hold is one, however many images it has.
        on = (steps[1:] != 0) & (np.sign(steps[1:]) == np.sign(steps[:-1]))
        turning_points = 1 + np.flatnonzero(~on)
    rows = []
    for t in np.setdiff1d(np.arange(1, n - 1), turning_points):
        before, after = abs(steps[t - 1]), abs(steps[t])
        if not (before > 0 and after > 0):
            raise ImageError(f"image {t}: the stage did not travel between it and a neighbour.")
        row = np.zeros(n)
        row[t - 1 : t + 2] = [1 / before, -1 / before - 1 / after, 1 / after]
        rows.append(row * 2 / (before + after) * length**2)
    if not rows:
        raise ImageError("the stage did not travel on over any three images in turn.")
    bending = np.array(rows)
    heard = np.ones(n) if kept is None else np.where(kept, 1.0, _UNHEARD)
    smoother = np.linalg.solve(np.diag(heard) + bending.T @ bending, np.diag(heard))
    once = np.eye(n) + np.ones((n, n)) / n_reference
    return Smoothed(
        coefficients=smoother @ coefficients,
        smoother=smoother,
        covariance_in_time=smoother @ once @ smoother.T,
    )


def smoothed_motion(
    motion: SurfaceMotion,
    images: SurfaceImages,
    travel: FloatArray,
    length: float,
    kept: BoolArray | None = None,
) -> tuple[SurfaceMotion, FloatArray]:
    """Smooth the motion of a series along stage travel, the stage's own shifts left alone.

    The stage re-centres and refocuses at every image: the mean over the pixels of each component
    is set aside, what is left is smoothed, and the mean put back. So a number that a translation
    does not touch (elongation, tilt) has the covariance S C Sᵀ, C that between the images before,
    and the means themselves keep theirs. χ counts the degrees of freedom anew: of the f that were
    fitted to a frame, 3 for its mean and (f − 3)(2 S − S Sᵀ)_tt for the rest.

    Args:
        motion: measured motion.
        images: the images behind it.
        travel: as in `smooth_along_travel`.
        length: as there.
        kept: as there.

    Returns:
        the motion, its `covariance_one` still that of single images; S, shape (T, T).

    Raises:
        ImageError: as in `smooth_along_travel`.
    """
    n_uv, n_w = len(motion.basis_uv.nodes), len(motion.basis_w.nodes)
    shift = np.repeat(motion.means(), [n_uv, n_uv, n_w], axis=1)
    result = smooth_along_travel(
        motion.coefficients - shift, travel, length, motion.n_reference, None, kept
    )
    smoothed = replace(motion, coefficients=shift + result.coefficients)
    s = result.smoother
    share = 2.0 * s.diagonal() - (s**2).sum(axis=1)
    freedom = 3.0 + (motion.system.freedom() - 3.0) * share
    chi = np.where(motion.lost, motion.chi, images.chi(smoothed.fields, freedom))
    return replace(smoothed, chi=chi), s
