"""Tests whose stage moves on steadily, for truths that are simulated on many cells."""

from __future__ import annotations

from collections.abc import Sequence

from driver.experiment.history import History
from driver.virtual.truth import history_of_rows


def steady_history(
    cycles: Sequence[tuple[int, int]], move: float, seconds: float, hold: float
) -> History:
    """Make a stage move on slowly from image to image, and hold at each peak before its image.

    A hold before every image, as a microscope that scans needs it, would double the intervals
    that each simulation has to go through.

    Args:
        cycles: images during loading and during unloading of each cycle.
        move: stage travel from one image to the next [µm].
        seconds: time from one image to the next [s].
        hold: time at a peak before its image [s].
    """
    time, stage, rows = 0.0, 0.0, [(0.0, 0.0, True)]
    for up, down in cycles:
        for k, step in enumerate(up * [move] + down * [-move]):
            time, stage = time + seconds, stage + step
            rows.append((time, stage, k != up - 1))
            if k == up - 1:
                time += hold
                rows.append((time, stage, True))
    return history_of_rows(rows)
