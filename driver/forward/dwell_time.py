"""Holds that last longer or shorter than stamped: the clock of the history with another length.

Every hold of the stage lasts by the same error longer, and what follows comes later; within a
hold its instants keep their share of it.
"""

from __future__ import annotations

import numpy as np

from meshes.arrays import BoolArray, FloatArray

_SHORTEST = 0.05  # share of its stamped length that a hold keeps at least
_STILL = 1e-9  # change of the knot weights below which the stage stands


def dwells(weights: FloatArray) -> BoolArray:
    """Return the intervals between two instants over which the stage stands, shape (n_times − 1,).

    Args:
        weights: weights of the knots at each instant, shape (n_times, n_knots).
    """
    return np.asarray(np.abs(np.diff(weights, axis=0)).max(axis=1, initial=0.0) < _STILL)


def stretch_dwells(times: FloatArray, still: BoolArray, error: float) -> FloatArray:
    """Return the instants of a history whose holds last longer [s], shape (n_times,).

    Args:
        times: instants as stamped [s], shape (n_times,).
        still: intervals over which the stage stands, shape (n_times − 1,).
        error: by how much each hold is longer [s]; none is cut to less than a twentieth.
    """
    if error == 0.0:
        return times
    share = np.maximum(1.0 + error / _stamped(times, still), _SHORTEST)
    lengths = np.diff(times) * share
    return np.asarray(times[0] + np.concatenate([[0.0], np.cumsum(lengths)]))


def dwells_tangent(times: FloatArray, still: BoolArray, error: float) -> FloatArray:
    """Return the derivative of `stretch_dwells` by the error, shape (n_times,).

    A hold of which only a twentieth is left does not follow the error.

    Args:
        times: instants as stamped [s], shape (n_times,).
        still: intervals over which the stage stands, shape (n_times − 1,).
        error: by how much each hold is longer [s].
    """
    stamped = _stamped(times, still)
    follows = 1.0 + error / stamped > _SHORTEST
    rates = np.where(follows, np.diff(times) / stamped, 0.0)
    return np.concatenate([[0.0], np.cumsum(rates)])


def _stamped(times: FloatArray, still: BoolArray) -> FloatArray:
    """Length of the hold of each interval [s], ∞ outside of holds, shape (n_times − 1,)."""
    number = np.cumsum(np.diff(still, prepend=False) & still)
    lengths = np.bincount(number[still], np.diff(times)[still], minlength=number.max(initial=0) + 1)
    return np.where(still, lengths[number], np.inf)
