"""Noise of the images that is not the same at all pixels, as a cause: steep flanks and defocus.

The residual is split into modes in time; a model error is slow, so that the fast half is noise.
The power of each fast mode is regressed on the square of the slope and on the place in the field:
under even noise the coefficients scatter about zero from mode to mode, and their mean is tested
by their own scatter (Hotelling), whatever the level of the noise and however neighbouring pixels
share it by interpolation.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from driver.common.distributions import f_sf
from driver.diagnosis.answer.verdict import Verdict, to_confirm
from driver.diagnosis.causes.all_causes import names
from driver.diagnosis.causes.candidates import NotExamined
from driver.diagnosis.causes.noise_causes import NOISE_NOT_UNIFORM
from driver.diagnosis.statistics.score_test import NAMING_LEVEL, SEEN_AT, Score
from driver.identification.cosine_modes import fast_modes
from driver.identification.data import Data
from driver.identification.objective import Evaluation
from driver.parameters.covariance import NOISE_RATIO
from meshes.arrays import FloatArray

EVEN_ENOUGH = 1.15  # ratio of σ below which weights change no answer
_QUIETEST = 0.2  # of the mean variance


@dataclass(frozen=True, eq=False)
class Unevenness:
    """How the noise varies over the pixels.

    Attributes:
        score: of the cause.
        variance: of each pixel over its mean, by the features, shape (n_pix,).
        ratio: σ of the noisiest twentieth over that of the quietest.
        sigma: standard deviation of the ratio.
    """

    score: Score
    variance: FloatArray
    ratio: float
    sigma: float

    @property
    def named(self) -> bool:
        """Whether it is significant, and large enough to matter."""
        return self.score.p < NAMING_LEVEL and self.ratio > EVEN_ENOUGH


def examine_noise(
    at: Evaluation, data: Data, wanted: tuple[str, ...] | None, n_grains: int = 2
) -> Unevenness | NotExamined | None:
    """How the noise varies, or why that is not asked; None where the cause is not wanted."""
    if wanted is not None and NOISE_NOT_UNIFORM.name not in wanted:
        return None
    if data.jitter is not None:
        why = "boundary.jitter_nm is stated, whose answers are those of pixels that count alike"
        return NotExamined(NOISE_NOT_UNIFORM.name, why)
    if data.image.variance is not None:
        return NotExamined(NOISE_NOT_UNIFORM.name, "images.noise_map states it")
    uneven = unevenness(at, data, len(names(n_grains)) + 1)
    few = NotExamined(NOISE_NOT_UNIFORM.name, "there are too few images to tell noise by")
    return few if uneven is None else uneven


def with_uneven_noise(verdict: Verdict) -> Verdict:
    """Let a verdict say so besides; where it said that nothing is wrong, this is its name."""
    sentence = f"{NOISE_NOT_UNIFORM.sentence[:1].upper()}{NOISE_NOT_UNIFORM.sentence[1:]}"
    nothing = verdict.kind == "nothing wrong"
    return replace(
        verdict,
        kind="named" if nothing else verdict.kind,
        sets=((NOISE_NOT_UNIFORM,), *verdict.sets),
        text=f"{sentence}; the images were weighted accordingly. {verdict.text}",
        next=f"{to_confirm(NOISE_NOT_UNIFORM)} {verdict.next}",
    )


def unevenness(at: Evaluation, data: Data, family: int) -> Unevenness | None:
    """Score the noise of the images; None where there are too few of them.

    Args:
        at: a fit.
        data: the measurements.
        family: number of tries, of which a cause is one.
    """
    rho = at.rho[data.with_image]
    modes = fast_modes(len(rho))
    whole = np.all(rho != 0.0, axis=0)  # pixels that no frame lacks
    every = _features(data)
    features = every - every[whole].mean(axis=0)
    m, q = len(modes), features.shape[1]
    if m < 3 * q:
        return None
    power = (modes @ rho[:, whole]) ** 2
    slopes = np.linalg.lstsq(features[whole], power.T / power.mean(), rcond=None)[0].T
    mean, scatter = slopes.mean(axis=0), np.cov(slopes.T) / m
    square = float(mean @ np.linalg.solve(scatter, mean))
    p = float(f_sf(square * (m - q) / (q * (m - 1)), q, m - q))
    variance = np.maximum(1.0 + features @ mean, _QUIETEST)
    low, high = np.percentile(variance[whole], (5, 95))
    ratio = float(np.sqrt(high / low))
    reach = np.ptp(np.percentile(features[whole], (5, 95), axis=0), axis=0)
    spread = 0.5 * reach * np.sqrt(np.diag(scatter))  # of ln σ between quiet and noisy
    widest = int(np.argmax(np.abs(mean) * reach))
    in_scales = np.array([np.log(ratio), spread[widest], SEEN_AT * spread.min()])
    estimate, sigma, visible = in_scales / NOISE_RATIO.scale
    evidence = 0.5 * m * np.log1p(square / (m - 1)) - 0.5 * q * np.log(m)
    score = Score(
        cause=NOISE_NOT_UNIFORM,
        statistic=square,
        degrees=q,
        p=min(1.0, p * family),
        family=family,
        log_evidence=float(evidence),
        estimate=np.array([estimate]),
        sigma=np.array([sigma]),
        visible=np.array([visible]),
        components=np.empty(0),
        directions=np.empty((0, at.residual.size)),
        strengths=np.empty(0),
    )
    return Unevenness(score, variance, ratio, ratio * float(spread[widest]))


def _features(data: Data) -> FloatArray:
    """Square of the slope, and place in the field with its squares, of unit spread (n_pix, 5)."""
    images = data.image.images
    place = images.xy - images.xy.mean(axis=0)
    steep = np.sum(images.gradient**2, axis=1, keepdims=True)
    columns = np.concatenate([steep, place, place**2], axis=1)
    return np.asarray(columns / columns.std(axis=0))
