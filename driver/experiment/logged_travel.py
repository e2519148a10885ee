"""Stage travel as a log has it: its noise, the rows at which it bends, and its holds.

The noise σ is the median deviation of a row from the line through its neighbours, over that of a
normal distribution of unit variance. It counts as noise where the deviations have no memory: their
signs are not those of three rows later. A history of few rows, each of which begins or ends a
move, has such a memory, and a travel that bends smoothly has it, too.

A reversal of less than ten σ is none: the extremes of some ten thousand rows differ by less. A
bend is one beyond ten σ, or beyond three where two lines fit the rows better than one by more
than chance ever does.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.linalg import solveh_banded

from meshes.arrays import BoolArray, FloatArray, IntArray

SIGNIFICANT = 10.0
"""Standard deviations of the noise above which a bend or a reversal is one."""
# A row that only logs a load is left out where the travel is straight within this share.
_STRAIGHT = 0.002
_MEDIAN = 0.67449  # of the size of a normal number of unit variance
_FEWEST = 50  # rows from which a noise is estimated
_MEMORY = 0.3  # mean product of the signs three rows apart, from which deviations have a memory
_SMALLEST = 1e-5  # of the range of the travel: less is the rounding of the file
_STILL = 3.0  # σ that the travel may change by in a hold
_NEAR = 3  # rows from an instant at which another bend may be
_BETTER = 60.0  # σ² by which two lines fit better than one, where chance makes it 20 or so


def noise_of_travel(time: FloatArray, stage: FloatArray, logged: BoolArray) -> float:
    """Return the standard deviation of the noise of a logged travel, 0 where none is found.

    Args:
        time: instants [s], increasing, shape (n,).
        stage: stage travel [µm], shape (n,).
        logged: rows that are no more than part of the log, shape (n,).
    """
    inner = logged[1:-1]
    if np.count_nonzero(inner) < _FEWEST:
        return 0.0
    after = (time[1:-1] - time[:-2]) / (time[2:] - time[:-2])
    off = stage[1:-1] - (1.0 - after) * stage[:-2] - after * stage[2:]
    off = (off / np.sqrt(1.0 + after**2 + (1.0 - after) ** 2))[inner]
    noise = float(np.median(np.abs(off))) / _MEDIAN
    if noise <= _SMALLEST * np.ptp(stage):
        return 0.0
    memory = abs(float(np.mean(np.sign(off[3:]) * np.sign(off[:-3]))))
    return noise if memory < _MEMORY else 0.0


def instants(
    time: FloatArray, stage: FloatArray, stated: BoolArray, noise: float
) -> tuple[IntArray, FloatArray]:
    """Return the rows that are instants of the history, and the stage travel in them.

    Those that are stated, the first and the last, and those of the log at which the travel
    bends. The travel of a log with noise is that of the line that fits all its rows best, and is
    the same at the beginning and at the end of a hold.

    Args:
        time: instants [s], increasing, shape (n,).
        stage: stage travel [µm], shape (n,).
        stated: rows that are instants for themselves, shape (n,).
        noise: of the travel [µm].

    Returns:
        Rows, increasing, shape (m,), and stage travel [µm], shape (m,).
    """
    fixed = stated.copy()
    fixed[[0, -1]] = True
    straight = np.full(time.size, _STRAIGHT * np.ptp(stage))
    if noise == 0.0:
        rows = _bends(time, stage, fixed, straight)
        return rows, stage[rows]
    # A move that begins between two rows bends in both: its beginning is known to a row on either
    # side, and so is the travel there.
    step = np.abs(np.diff(stage))
    two_rows = 2.0 * np.maximum(np.append(step, 0.0), np.append(0.0, step))
    tolerance = np.maximum(straight, SIGNIFICANT * noise) + two_rows
    rows = _placed(time, stage, _bends(time, stage, fixed, tolerance), fixed)
    rows = _placed(time, stage, _with_small_bends(time, stage, rows, noise), fixed)
    return rows, _levelled(stage, rows, _fitted(time, stage, rows), _STILL * noise)


def _bends(
    time: FloatArray, stage: FloatArray, fixed: BoolArray, tolerance: FloatArray
) -> IntArray:
    """Return the fixed rows, and those that lines need to be within the tolerance of each row."""
    kept = fixed.copy()
    while True:
        rows = np.flatnonzero(kept)
        off = np.abs(stage - np.interp(time, time[rows], stage[rows]))
        worst = [a + int(np.argmax(off[a:b])) for a, b in pairwise(rows.tolist())]
        bends = [row for row in worst if off[row] > tolerance[row]]
        if not bends:
            return rows
        kept[bends] = True


def _placed(time: FloatArray, stage: FloatArray, rows: IntArray, fixed: BoolArray) -> IntArray:
    """Move each bend of the log to where two lines fit the rows up to the next instants best.

    Of bends nearer to an instant than two rows none is left: they are one, between two rows.
    """
    placed: list[int] = []
    for row in rows.tolist():
        if placed and row - placed[-1] < _NEAR:
            if not fixed[row]:
                continue
            if not fixed[placed[-1]]:
                placed.pop()
        placed.append(row)
    for k, row in enumerate(placed):
        if not fixed[row]:
            first, last = placed[k - 1], placed[k + 1]
            part = slice(first, last + 1)
            placed[k] = first + _bend(time[part], stage[part])[0]
    return np.array(placed)


def _with_small_bends(
    time: FloatArray, stage: FloatArray, rows: IntArray, noise: float
) -> IntArray:
    """Add rows at which the travel bends by less than ten σ, and yet beyond doubt.

    Two lines have to fit the rows between two instants far better than one, and the bend has to
    be larger than what a hold may change by. Rows next to the instants do not count: a move may
    begin between rows.
    """
    kept, open_parts = set(rows.tolist()), list(pairwise(rows.tolist()))
    while open_parts:
        first, last = open_parts.pop()
        if last - first < 4 * _NEAR:
            continue
        part = slice(first + _NEAR, last - _NEAR + 1)
        bend, gain, height = _bend(time[part], stage[part])
        if gain > _BETTER * noise**2 and height > _STILL * noise:
            row = first + _NEAR + bend
            kept.add(row)
            open_parts += [(first, row), (row, last)]
    return np.array(sorted(kept))


def _bend(time: FloatArray, stage: FloatArray) -> tuple[int, float, float]:
    """Find the row at which a line with one bend fits the travel best.

    The bend is a ramp (t − t_b)₊ beside the line; its part that is orthogonal to lines follows for
    all rows b at once from sums over the rows behind b.

    Args:
        time: instants [s], increasing, shape (n,), three at least.
        stage: stage travel [µm], shape (n,).

    Returns:
        The row, by how much the sum of squares is smaller than that of a line [µm²], and how far
        the bend is off the line between the ends [µm].
    """
    t = time - time.mean()
    spread = float(t @ t)
    rest = stage - stage.mean() - t * (t @ stage) / spread

    def behind(values: FloatArray) -> FloatArray:
        return np.cumsum(values[::-1])[::-1] - values

    ones, once, twice = behind(np.ones_like(t)), behind(t), behind(t**2)
    on_rest = behind(t * rest) - t * behind(rest)
    on_one, on_t = once - t * ones, twice - t * once
    size = twice - 2.0 * t * once + t**2 * ones - on_one**2 / t.size - on_t**2 / spread
    inner = slice(1, t.size - 1)
    slope = on_rest[inner] / np.maximum(size[inner], np.finfo(float).tiny)
    gain = slope * on_rest[inner]
    best = int(np.argmax(gain))
    before, after = t[best + 1] - t[0], t[-1] - t[best + 1]
    return best + 1, float(gain[best]), abs(slope[best]) * before * after / (before + after)


def _fitted(time: FloatArray, stage: FloatArray, rows: IntArray) -> FloatArray:
    """Return the travel in some rows of the line between them that fits all rows best [µm]."""
    left = np.clip(np.searchsorted(rows, np.arange(time.size), side="right") - 1, 0, rows.size - 2)
    share = (time - time[rows[left]]) / (time[rows[left + 1]] - time[rows[left]])
    before, n = 1.0 - share, rows.size

    def summed(at: IntArray, values: FloatArray) -> FloatArray:
        return np.asarray(np.bincount(at, values, minlength=n), dtype=np.float64)

    normal = np.zeros((2, n))
    normal[1] = summed(left, before**2) + summed(left + 1, share**2)
    normal[0] = summed(left + 1, share * before)
    right = summed(left, before * stage) + summed(left + 1, share * stage)
    return np.asarray(solveh_banded(normal, right))


def _levelled(stage: FloatArray, rows: IntArray, fitted: FloatArray, still: float) -> FloatArray:
    """Return the travel in the instants with one value in each hold, the mean of its rows.

    Args:
        stage: stage travel of all rows [µm], shape (n,).
        rows: those of the instants, shape (m,).
        fitted: travel in the instants [µm], shape (m,).
        still: change of the travel between two instants that is none [µm].
    """
    moves = np.array([True, *(_change(stage[a + 1 : b]) > still for a, b in pairwise(rows))])
    levelled = fitted.copy()
    starts = np.flatnonzero(moves)
    for first, last in zip(starts, [*(starts[1:] - 1), rows.size - 1], strict=True):
        if last > first:
            levelled[first : last + 1] = stage[rows[first] + 1 : rows[last]].mean()
    return levelled


def _change(stage: FloatArray) -> float:
    """By how much the travel changes over some rows, from their halves; ∞ of fewer than two."""
    half = stage.size // 2
    if not half:
        return np.inf
    return 2.0 * abs(float(stage[-half:].mean() - stage[:half].mean()))
