"""Loads that are wrong one by one, and the noise of the others, both from the fast load residual.

A model error is slow in time. The fast half of the cosine modes of the loads, fitted together
with the images, leaves little else than noise: y = V^(−1/2) B r has the covariance s² I, with B
the modes, r the residual of that fit, V what it leaves of unit noise, and s the noise over the
stated one. In y an error of a single load is a known direction. Its t statistic, the externally
studentised and leverage-corrected residual, is exact whatever s is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm, t

from driver.identification.data import Data
from driver.identification.fit import Evaluation

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

LEVEL = 0.01  # of all loads together
MOST = 0.05  # share of the loads beyond which they are no outliers but noise of another kind
_SUSPECT = 3.5  # robust standard deviations
_RIDGE = 1e-12
# Variance that the fit has left of a direction. What it takes more of is where the model moves fast
# loads, and an error of the model shows there as if it were noise.
_LEFT = 0.9
_WIDE = 10.0  # prior scales
_FEWEST = 8  # degrees of freedom without which nothing is said of the noise


@dataclass(frozen=True)
class BadLoad:
    """A load that belongs to no smooth course.

    Attributes:
        frame: its image.
        off: by how much it is off [µN].
        sigmas: the same over its standard deviation, by the noise of the other loads.
    """

    frame: int
    off: float
    sigmas: float


@dataclass(frozen=True, eq=False)
class _Fast:
    """The fast load residual, m numbers of one variance.

    Attributes:
        residual: y, shape (m,).
        single: what 1 µN in each load makes of it, shape (T, m).
    """

    residual: FloatArray
    single: FloatArray


def bad_loads(
    fitted: Evaluation, data: Data, causes: Sequence[FloatArray] = ()
) -> tuple[BadLoad, ...]:
    """The loads that are wrong one by one, at a family-wise level of 1 %.

    Suspects are collected one after the other against a robust scale, so that none hides behind
    another; together they are tested, and the least is acquitted until all are significant. They
    have to stay significant with any cause freed: an offset shows most in the first load, a lag
    in those at the turning points.

    Args:
        fitted: a fit to these data.
        data: the data.
        causes: whitened sensitivities per prior scale of each cause, shapes (k_c, n).

    Returns:
        In the order of the frames; none where there are too few loads or too many suspects.
    """
    if fitted.n_load < 2 * _FEWEST:
        return ()
    unit = data.load_changes(np.eye(fitted.n_load))
    fast = _fast(fitted, unit)
    found = _suspects(fast, max(1, int(MOST * fitted.n_load)))
    found = _significant(fast, found)
    for effect in causes if found else ():
        found = _significant(_fast(_freed(fitted, effect), unit), found)
    if not found:
        return ()
    frames = data.load_index[found]
    off, sigma = _joint(fast, found)
    ends = sorted(zip(frames.tolist(), off.tolist(), (off / sigma).tolist(), strict=True))
    return tuple(BadLoad(*end) for end in ends)


def _significant(fast: _Fast, found: Sequence[int]) -> list[int]:
    """Those of some loads that are wrong at the level of the family, fitted together."""
    left = list(found)
    while left:
        degrees = fast.residual.size - len(left)
        if degrees < _FEWEST:
            return []
        off, sigma = _joint(fast, left)
        p = len(fast.single) * 2 * t.sf(np.abs(off) / sigma, degrees)
        if np.all(p < LEVEL):
            return left
        left.pop(int(np.argmax(p)))
    return left


def _freed(fitted: Evaluation, effect: FloatArray) -> Evaluation:
    """An evaluation with a cause freed, at its null, within a wide prior."""
    more = np.zeros(len(effect))
    return replace(
        fitted,
        jacobian=np.concatenate([fitted.jacobian, effect]),
        prior_gap=np.concatenate([fitted.prior_gap, more]),
        prior_weight=np.concatenate([fitted.prior_weight, more + _WIDE**-2]),
    )


def load_noise(fitted: Evaluation, data: Data) -> tuple[float, float]:
    """The noise of the loads over the stated one, and the degrees of freedom of that estimate.

    Noise of the boundary moves loads as well, and hides their own noise, which then stays as
    stated.
    """
    if fitted.n_load < 2 * _FEWEST or data.jitter is not None:
        return 1.0, np.inf
    y = _fast(fitted, data.load_changes(np.eye(fitted.n_load))).residual
    if y.size < _FEWEST:
        return 1.0, np.inf
    return float(np.sqrt(np.mean(y**2))), float(y.size)


def _fast(fitted: Evaluation, unit: FloatArray) -> _Fast:
    """The fast residual of a fit to images and fast loads alone: slow loads do not enter it."""
    T, J = fitted.n_load, fitted.jacobian
    modes = _fast_modes(T)
    through = modes @ J[:, :T].T  # B Jᵀ
    images = J[:, T:]
    H = through.T @ through + images @ images.T + np.diag(fitted.prior_weight)
    H += _RIDGE * np.trace(H) * np.eye(len(H))

    def seen(numbers: FloatArray) -> FloatArray:
        return np.asarray(through.T @ (modes @ numbers[:T]) + images @ numbers[T:])

    taken = np.linalg.solve(H, through.T).T
    left, vector = np.linalg.eigh(np.eye(len(modes)) - taken @ through.T)
    kept = left > _LEFT
    root = (vector[:, kept] / np.sqrt(left[kept])).T
    gradient = seen(fitted.residual) + fitted.prior_weight * fitted.prior_gap
    residual = modes @ fitted.residual[:T] - taken @ gradient
    single = modes @ unit[:, :T].T - taken @ seen(unit.T)
    return _Fast(root @ residual, (root @ single).T)


def _fast_modes(T: int) -> FloatArray:
    """The fast half of the orthonormal cosines, shape (T − T//2, T)."""
    modes = np.cos(np.pi * np.outer(np.arange(T // 2, T), np.arange(T) + 0.5) / T)
    return np.asarray(np.sqrt(2 / T) * modes)


def _suspects(fast: _Fast, most: int) -> list[int]:
    """Loads that stand out of a robust scale, the worst first; none where they are too many."""
    found: list[int] = []
    while True:
        basis = (
            np.linalg.qr(fast.single[found].T)[0] if found else np.zeros((len(fast.residual), 0))
        )
        y = fast.residual - basis @ (basis.T @ fast.residual)
        single = fast.single - (fast.single @ basis) @ basis.T
        length = np.linalg.norm(single, axis=1)
        seen = length > 0.1 * np.median(np.linalg.norm(fast.single, axis=1))
        z = np.where(seen, single @ y / np.where(seen, length, 1.0), 0.0)
        scale = float(np.median(np.abs(z[seen]))) / float(norm.ppf(0.75))
        worst = int(np.argmax(np.abs(z)))
        if abs(z[worst]) < _SUSPECT * scale:
            return found
        if len(found) == most:
            return []
        found.append(worst)


def _joint(fast: _Fast, found: Sequence[int]) -> tuple[FloatArray, FloatArray]:
    """Errors of these loads fitted together, and their standard deviations [µN]."""
    X = fast.single[list(found)].T
    off, *_ = np.linalg.lstsq(X, fast.residual, rcond=None)
    rest = fast.residual - X @ off
    variance = float(rest @ rest) / (fast.residual.size - len(found))
    sigma = np.sqrt(variance * np.diag(np.linalg.inv(X.T @ X)))
    return np.asarray(off), np.asarray(sigma)
