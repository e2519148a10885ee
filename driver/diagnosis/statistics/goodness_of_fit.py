"""Tests of a residual against no particular alternative: is anything left?

A model error is slow in time, noise is not. Each signal is therefore compared with itself: the
power of its slow modes against that of its fast ones (F test), so that no error in the assumed
noise level can raise a false alarm. The load is also tested for serial correlation, and each
image against all others: what is wrong in one of them alone is neither slow nor serial. All causes
of the library are tested together: what none of them describes alone, some may together. Last come
the smooth motions that grow with the stretch, which need be like no cause.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from driver.common.distributions import chi2_sf, f_sf, normal_ppf, normal_sf
from driver.diagnosis.statistics.score_test import beside, score_together
from driver.identification.cosine_modes import cosine_modes
from driver.identification.data import Data
from driver.identification.objective import Evaluation
from meshes.arrays import FloatArray

LAGS = 10
SLOW_SHARE = 8  # the slowest eighth of the modes against the fastest half
FAMILY_LEVEL = 0.01
_MIDDLE = 0.25, 0.75  # quantiles between which images tell how much images spread
_LEFT = 0.1  # share of the variance below which the fit has taken a direction


@dataclass(frozen=True)
class GoodnessOfFit:
    """Probabilities of residuals as structured as these, were the model right.

    Attributes:
        load_slow: slow against fast modes of the load.
        load_serial: Ljung–Box test of the load.
        image_slow: slow against fast modes of the images.
        image_outlier: the image that stands out most against the others, times their number.
        together: all causes of the library at once.
        smooth: smooth motions of the face in proportion to its stretch.
        left: misfit above that of noise, as the slow modes, the causes together or the smooth
            motions show it, the most of them [σ²].
    """

    load_slow: float
    load_serial: float
    image_slow: float
    image_outlier: float
    together: float
    smooth: float
    left: float

    @property
    def accepted(self) -> bool:
        """Whether nothing is left at a family-wise level of 1 %."""
        return not self.seen

    @property
    def seen(self) -> tuple[str, ...]:
        """What is no noise at that level, in words."""
        tests = {
            "a slow part of the loads": self.load_slow,
            "loads that follow one another": self.load_serial,
            "a slow part of the images": self.image_slow,
            "an image that stands out": self.image_outlier,
            "what several causes of the library together describe": self.together,
            "a smooth motion of the face that grows with its stretch": self.smooth,
        }
        return tuple(what for what, p in tests.items() if len(tests) * p <= FAMILY_LEVEL)


def goodness_of_fit(
    fitted: Evaluation,
    data: Data,
    effects: Sequence[FloatArray],
    fields: FloatArray,
    own: FloatArray,
    variance: float = 1.0,
) -> GoodnessOfFit:
    """Test a fitted residual; what the fit has taken from it is counted exactly.

    The residual of a linear fit has the covariance I − BᵀB, B = L⁻¹J with LLᵀ the Hessian.

    Args:
        fitted: the fit.
        data: the data.
        effects: whitened sensitivities of the causes that could be added, shapes (k_c, n).
        fields: whitened effects of smooth motions, shape (k_s, n).
        own: whitened shapes of the simulation's own error, shape (m, n); a mesh errs smoothly, too,
            and what looks like that is no smooth motion.
        variance: of whitened numbers along either, 1 for noise alone.
    """
    k = len(fitted.free)
    taken = np.linalg.solve(np.linalg.cholesky(fitted.hessian), fitted.jacobian)
    loads, of_loads = fitted.residual[: fitted.n_load], taken[:, : fitted.n_load]
    images = data.image_part(fitted.residual)
    of_images = taken[:, fitted.n_load :].reshape(k, *images.shape)
    load_slow, in_loads = _slow_against_fast(loads[:, None], of_loads[..., None])
    image_slow, in_images = _slow_against_fast(images, of_images)
    together = score_together(effects, fitted, data.load_degrees, variance)
    smooth = score_together([fields], beside(fitted, own), data.load_degrees, variance)
    beyond = (t.statistic - t.degrees for t in (together, smooth))
    return GoodnessOfFit(
        load_slow=load_slow,
        load_serial=_serial(loads, np.eye(loads.size) - of_loads.T @ of_loads),
        image_slow=image_slow,
        image_outlier=_outlier(images, of_images),
        together=together.p,
        smooth=smooth.p,
        left=max(in_loads, in_images, *beyond, 0.0),
    )


def _slow_against_fast(signal: FloatArray, taken: FloatArray) -> tuple[float, float]:
    """F test on a signal (T, n) from which a fit has taken (k, T, n); what is slow beyond noise."""
    T, k = len(signal), len(taken)
    powers, degrees = [], []
    for orders in (np.arange(T // SLOW_SHARE), np.arange(T // 2, T)):
        modes = cosine_modes(T, orders)
        power, free = _free_power((modes @ signal).ravel(), (modes @ taken).reshape(k, -1))
        powers.append(power)
        degrees.append(free)
    if not all(degrees):
        return 1.0, 0.0
    ratio = (powers[0] / degrees[0]) / (powers[1] / degrees[1])
    return float(f_sf(ratio, degrees[0], degrees[1])), (ratio - 1.0) * degrees[0]


def _outlier(signal: FloatArray, taken: FloatArray) -> float:
    """F tests of the power of each image against that of the others, on a signal (T, n).

    Levels of measured images differ by a few per cent: where the powers of the middle half of the
    images spread more than that distribution has it, it is taken that much wider.
    """
    power = np.sum(signal**2, axis=1)
    degrees = signal.shape[1] - np.sum(taken**2, axis=(0, 2))
    others, left = power.sum() - power, degrees.sum() - degrees
    # Standard normal numbers for the ratios (Paulson 1942), finite for those that are absurd.
    root, own, rest = np.cbrt((power / degrees) / (others / left)), 2 / 9 / degrees, 2 / 9 / left
    deviates = (root * (1 - rest) - (1 - own)) / np.sqrt(root**2 * rest + own)
    low, high = np.quantile(deviates, _MIDDLE)
    spread = (high - low) / np.diff(normal_ppf(_MIDDLE))[0]
    return float(min(1.0, len(signal) * normal_sf(deviates.max() / max(spread, 1.0))))


def _free_power(x: FloatArray, taken: FloatArray) -> tuple[float, int]:
    """Σ x² in units of its variance I − takenᵀ taken, and in how many directions."""
    _, strength, across = np.linalg.svd(taken, full_matrices=False)
    along, left = across @ x, 1.0 - strength**2
    free = left > _LEFT
    power = float(x @ x - along @ along + np.sum(along[free] ** 2 / left[free]))
    return power, x.size - int(np.count_nonzero(~free))


def _serial(loads: FloatArray, covariance: FloatArray) -> float:
    """Portmanteau test over ten lags, for a residual whose own covariance R is not quite white.

    The autocorrelations u_l = zᵀA_l z/zᵀz have the means m_l = tr(A_l R)/tr R and, with
    B_l = A_l − m_l I, the covariances V_lm = 2 tr(B_l R B_m R)/(tr R)². Without a fit Σ u_l²/V_ll
    is the statistic of Ljung and Box; its χ² has the mean and the variance that V gives.
    """
    T, trace = loads.size, float(np.trace(covariance))
    if trace < 2 * LAGS:
        return 1.0
    lagged = [0.5 * (np.eye(T, k=lag) + np.eye(T, k=-lag)) for lag in range(1, LAGS + 1)]
    means = np.array([np.sum(A * covariance) / trace for A in lagged])
    spread = [(A - m * np.eye(T)) @ covariance for A, m in zip(lagged, means, strict=True)]
    V = np.array([[np.sum(a * b.T) for b in spread] for a in spread]) * 2 / trace**2
    u = np.array([loads @ A @ loads for A in lagged]) / float(loads @ loads) - means
    variance = np.diag(V)
    stretch = float(np.sum(V**2 / np.outer(variance, variance))) / LAGS
    return float(chi2_sf(np.sum(u**2 / variance) / stretch, LAGS / stretch))
