"""The course of a test that has not been made: its history, changed, and its knots."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from driver.design.settings import Schedule
from driver.experiment.history import History, turning_points
from driver.parameters.boundary import elongation_names, tilt_names
from meshes.arrays import FloatArray


def changed(history: History, test: Schedule) -> History:
    """Return the history of a test that departs from another one: leg, then stops, then holds."""
    if test.compression:
        history = compressed(history)
    if test.stops > 1:
        history = with_stops(history, test.stops)
    return scale_dwells(history, test.holds)


def compressed(history: History) -> History:
    """With a last leg that goes back as far as the last loading went, stops and holds as there."""
    first, last = _last_loading(history)
    rows = np.arange(first + 1, last + 1)
    end = history.turning[-1]
    time = history.time[end] + history.time[rows] - history.time[first]
    stage = history.stage[end] - (history.stage[rows] - history.stage[first])
    images = history.image_row[(history.image_row > first) & (history.image_row <= last)]
    after = history.time.size + images - rows[0]
    return _history(
        np.concatenate([history.time, time]),
        np.concatenate([history.stage, stage]),
        np.concatenate([history.image_row, after]),
    )


def with_stops(history: History, number: int) -> History:
    """With so many stops in the place of one: each move in equal parts, a hold after each.

    A hold after a part is as long as the one after the whole move; an image is taken at its end
    where one is taken after the whole move.
    """
    images, travel = set(history.image_row.tolist()), np.diff(history.stage)
    rows: list[tuple[float, float, bool]] = [(history.time[0], history.stage[0], 0 in images)]
    late = 0.0  # what the holds have added
    for row in range(1, history.time.size):
        if travel[row - 1] != 0.0:
            held = row < travel.size and travel[row] == 0.0
            hold = history.time[row + 1] - history.time[row] if held else 0.0
            photographed = (row + 1 if held else row) in images
            for part in range(1, number):
                share = part / number
                time, stage = (
                    float((1 - share) * a[row - 1] + share * a[row])
                    for a in (history.time, history.stage)
                )
                rows.append((time + late, stage, photographed and not held))
                if held:
                    late += hold
                    rows.append((time + late, stage, photographed))
        rows.append((history.time[row] + late, history.stage[row], row in images))
    times, stages, taken = (np.array(column) for column in zip(*rows, strict=True))
    return _history(times, stages, np.flatnonzero(taken))


def scale_dwells(history: History, factor: float) -> History:
    """With every hold longer by a factor."""
    steps = np.diff(history.time)
    steps = np.where(np.diff(history.stage) == 0.0, factor * steps, steps)
    return replace(history, time=history.time[0] + np.concatenate([[0.0], np.cumsum(steps)]))


def carried_on(knots: Mapping[str, float], history: History, longer: History) -> dict[str, float]:
    """Knots of a history whose last phase goes on: at the pace of its last unloading.

    Motion is linear in stage travel within a phase. Where the history ends loaded, the pace of an
    earlier unloading is taken, or that of the loading itself.

    Args:
        knots: elongation and tilt at the turning points of the history [µm], by name.
        history: the history.
        longer: the same with a leg more.
    """
    extended = dict(knots)
    stage, far = history.stage[history.turning], longer.stage[longer.turning]
    back = [k for k in range(1, stage.size) if stage[k] < stage[k - 1]] or [stage.size - 1]
    for names in (elongation_names, tilt_names):
        old = np.array([0.0, *(knots[name] for name in names(history.n_knots))])
        pace = (old[back[-1]] - old[back[-1] - 1]) / (stage[back[-1]] - stage[back[-1] - 1])
        # The last turning point moves on, or stays and a new one follows.
        start = far.size - 2
        end = old[start] + pace * (far[-1] - far[start])
        extended[names(longer.n_knots)[-1]] = float(end)
    return extended


def _last_loading(history: History) -> tuple[int, int]:
    """Rows of the turning points between which the stage went forward for the last time."""
    stage = history.stage[history.turning]
    forward = [k for k in range(1, stage.size) if stage[k] > stage[k - 1]] or [1]
    return int(history.turning[forward[-1] - 1]), int(history.turning[forward[-1]])


def _history(time: FloatArray, stage: FloatArray, image_row: NDArray[np.int64]) -> History:
    none = np.zeros(image_row.size)
    turning, cycle = turning_points(stage), none.astype(np.int64)
    return History(time, stage, image_row, none, turning, cycle)
