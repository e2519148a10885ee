"""Loads that are wrong one by one, and the noise of the others, both from the fast load residual.

In y (see `high_pass_loads`) an error of a single load is a known direction. Its t statistic, the
externally studentised and leverage-corrected residual, is exact whatever the noise is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from driver.common.distributions import normal_ppf, t_sf
from driver.diagnosis.answer.result_types import BadLoad
from driver.diagnosis.statistics.high_pass_loads import FEWEST, LEFT, freed, high_pass_loads
from driver.identification.data import Data
from driver.identification.objective import Evaluation
from meshes.arrays import FloatArray

LEVEL = 0.01  # of all loads together
MOST = 0.05  # share of the loads beyond which they are no outliers but noise of another kind
_SUSPECT = 3.5  # robust standard deviations


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
    """Return the loads that are wrong one by one, at a family-wise level of 1 %.

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
    if fitted.n_load < 2 * FEWEST:
        return ()
    unit = data.load_changes(np.eye(fitted.n_load))
    fast = _fast(fitted, unit)
    suspects = _suspects(fast, max(1, int(MOST * fitted.n_load)))
    suspects = _significant(fast, suspects)
    for effect in causes if suspects else ():
        suspects = _significant(_fast(freed(fitted, effect), unit), suspects)
    if not suspects:
        return ()
    frames = data.load_index[suspects]
    off, sigma = _joint(fast, suspects)
    ends = sorted(zip(frames.tolist(), off.tolist(), (off / sigma).tolist(), strict=True))
    return tuple(BadLoad(*end) for end in ends)


def _fast(fitted: Evaluation, unit: FloatArray) -> _Fast:
    # One load, of a turning point say, may stand just where the model moves fast loads.
    fast = high_pass_loads(fitted, LEFT)
    return _Fast(fast.residual, fast.of(unit))


def _significant(fast: _Fast, found: Sequence[int]) -> list[int]:
    """Those of some loads that are wrong at the level of the family, fitted together."""
    left = list(found)
    while left:
        degrees = fast.residual.size - len(left)
        if degrees < FEWEST:
            return []
        off, sigma = _joint(fast, left)
        p = len(fast.single) * 2 * t_sf(np.abs(off) / sigma, degrees)
        if np.all(p < LEVEL):
            return left
        left.pop(int(np.argmax(p)))
    return left


def load_noise(fitted: Evaluation, data: Data) -> tuple[float, float]:
    """Return noise of the loads over the stated one, and the degrees of freedom of that estimate.

    Noise of the boundary moves loads as well, and hides their own noise, which then stays as
    stated.
    """
    if data.jitter is not None:
        return 1.0, data.load_degrees
    if fitted.n_load < 2 * FEWEST:
        return 1.0, np.inf
    y = high_pass_loads(fitted).residual
    if y.size < FEWEST:
        return 1.0, np.inf
    return float(np.sqrt(np.mean(y**2))), float(y.size)


def _suspects(fast: _Fast, most: int) -> list[int]:
    """Find loads that stand out of a robust scale, the worst first; none of too many."""
    rows: list[int] = []
    while True:
        basis = np.linalg.qr(fast.single[rows].T)[0] if rows else np.zeros((len(fast.residual), 0))
        y = fast.residual - basis @ (basis.T @ fast.residual)
        single = fast.single - (fast.single @ basis) @ basis.T
        length = np.linalg.norm(single, axis=1)
        seen = length > 0.1 * np.median(np.linalg.norm(fast.single, axis=1))
        z = np.where(seen, single @ y / np.where(seen, length, 1.0), 0.0)
        scale = float(np.median(np.abs(z[seen]))) / float(normal_ppf(0.75))
        worst = int(np.argmax(np.abs(z)))
        if abs(z[worst]) < _SUSPECT * scale:
            return rows
        if len(rows) == most:
            return []
        rows.append(worst)


def _joint(fast: _Fast, found: Sequence[int]) -> tuple[FloatArray, FloatArray]:
    """Errors of these loads fitted together, and their standard deviations [µN]."""
    X = fast.single[list(found)].T
    off, *_ = np.linalg.lstsq(X, fast.residual, rcond=None)
    rest = fast.residual - X @ off
    variance = float(rest @ rest) / (fast.residual.size - len(found))
    sigma = np.sqrt(variance * np.diag(np.linalg.inv(X.T @ X)))
    return np.asarray(off), np.asarray(sigma)
