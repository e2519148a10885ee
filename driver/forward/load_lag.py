"""The load between two rows of the history, for a load cell whose clock is not that of the images.

The simulated force is known in the rows of the history; between them it is taken as linear in
time. A row is often the end of a hold, where the force bends from relaxing to rising: a reading
takes a moment itself, and within half a second of a row the rate goes smoothly from that before
to that after it (cubic Hermite pieces), while the force in the row itself is not touched.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from driver.parameters.instrument import LARGEST_LAG
from meshes.arrays import FloatArray

_MOMENT = 0.5  # half of the time in which the rate changes at a row [s]


def load_at(times: FloatArray, force: FloatArray, at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Force at some instants, and its rate of change.

    Before the first and after the last row the force is that of the row.

    Args:
        times: of the rows [s], increasing, shape (n_rows,).
        force: in the rows, shape (..., n_rows).
        at: instants [s], at most `LARGEST_LAG` outside the rows, shape (T,).

    Returns:
        force and ∂force/∂time [1/s], shape (..., T) each.
    """
    beyond = LARGEST_LAG + 1.0
    known = np.concatenate([[times[0] - beyond], times, [times[-1] + beyond]])
    values = np.concatenate([force[..., :1], force, force[..., -1:]], axis=-1)
    length = np.diff(known)
    rate = np.diff(values) / length
    before, after = rate[..., :-1], rate[..., 1:]
    near = np.minimum(_MOMENT, np.minimum(length[:-1], length[1:]) / 4)
    places = np.stack([times - near, times, times + near], axis=-1).ravel()
    shape = (*force.shape[:-1], places.size)
    heights = np.stack([force - near * before, force, force + near * after], axis=-1)
    slopes = np.stack([before, (before + after) / 2, after], axis=-1)
    curve = CubicHermiteSpline(
        np.concatenate([known[:1], places, known[-1:]]),
        np.concatenate([values[..., :1], heights.reshape(shape), values[..., -1:]], axis=-1),
        np.concatenate([rate[..., :1], slopes.reshape(shape), rate[..., -1:]], axis=-1),
        axis=-1,
    )
    return np.asarray(curve(at)), np.asarray(curve(at, 1))
