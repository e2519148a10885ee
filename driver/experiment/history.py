"""The loading history: times, stage travel, images and loads, its cycles and its knots."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from driver.case.history import CLOCK, HistoryTable
from driver.common.errors import sentence
from driver.experiment.log_columns import Log, read_log
from driver.experiment.log_file import HistoryError
from driver.experiment.logged_travel import SIGNIFICANT, instants, noise_of_travel
from meshes.arrays import FloatArray, IntArray

_PLAIN = HistoryTable()
COLUMNS = ("time_s", "stage_um", "image", "force_N")
REVERSAL = 0.02
"""Share of its whole range by which the stage has turned: less is play or encoder noise."""
_TOLD = 12  # reversals at most that are told


@dataclass(frozen=True, eq=False)
class History:
    """What was done to the specimen, and when it was looked at.

    Attributes:
        time: instants [s], increasing, shape (n_rows,).
        stage: stage travel [µm], shape (n_rows,).
        image_row: row of each image, or of each load where no images were taken,
            shape (n_images,).
        force: macroscopic force at each image [N], shape (n_images,).
        turning: rows at which the stage turns, each at the end of its hold, with the first and
            the last row of the history, shape (n_knots,).
        cycle: cycle of each image, a loading with the unloading after it, counted from 1,
            shape (n_images,).
        stage_noise: standard deviation of the stage travel as it was logged [µm], 0 for none.
    """

    time: FloatArray
    stage: FloatArray
    image_row: IntArray
    force: FloatArray
    turning: IntArray
    cycle: IntArray
    stage_noise: float = 0.0

    @property
    def n_images(self) -> int:
        """Number of images."""
        return self.image_row.size

    @property
    def n_knots(self) -> int:
        """Number of turning points."""
        return self.turning.size


def read_history(
    path: Path,
    with_images: bool = True,
    with_loads: bool = True,
    stated: HistoryTable = _PLAIN,
) -> History:
    """Read a history: rows of time, stage travel, image and load.

    A row with a load but no image belongs to a log of loads. The load of an image that has none
    in its own row lies on the line between the loads logged before and after it. A row of the
    log is an instant of the history only where the stage travel bends.

    Args:
        path: the file.
        with_images: whether the images are read; if not, each load stands for itself, and the
            column of the images is not looked at.
        with_loads: whether the loads are needed; else they may be absent, and are 0.
        stated: how the file is written; by default a CSV file of time_s, stage_um, image, force_N.

    Raises:
        HistoryError: the file cannot be read as stated, times do not increase, images are not
            numbered 0, 1, 2, …, an image has no load, there are fewer than two images (loads),
            or the stage never moves.
    """
    kinds = {"time": True, "stage": True, "image": with_images, "force": with_loads}
    log = read_log(path, stated, [kind for kind, needed in kinds.items() if needed])
    time, stage, load = log.time, log.stage, log.force
    late = np.flatnonzero(np.diff(time) <= 0)
    if late.size:
        row = int(late[0]) + 1
        unit = "" if stated.time.unit == CLOCK else f" {stated.time.unit}"
        expected = f"more than the {log.text(row - 1, 'time')}{unit} before it"
        raise log.error(row, "time", log.text(row, "time"), expected)
    loaded = np.isfinite(load)
    seen = _image_rows(log) if with_images else np.flatnonzero(loaded)
    if seen.size < 2:
        kind, what = ("image", "images") if with_images else ("force", "loads")
        least = "image 0 and at least one more" if with_images else "at least two"
        raise HistoryError(sentence(path, log.columns[kind].name, f"{seen.size} {what}", least))
    if np.ptp(stage) == 0:
        found = f"{log.text(0, 'stage')} in every row"
        raise HistoryError(sentence(path, log.columns["stage"].name, found, "a stage that moves"))
    force = np.nan_to_num(load[seen])
    if with_loads:
        force = _load_of_images(log, seen)
    rows_stated = ~loaded
    rows_stated[seen] = True
    noise = noise_of_travel(time, stage, ~rows_stated if with_images else loaded)
    kept, stage = instants(time, stage, rows_stated, noise if with_images else 0.0)
    time, seen = time[kept], np.searchsorted(kept, seen)
    turning = turning_points(stage, noise)
    return History(
        time=time,
        stage=stage,
        image_row=seen,
        force=force,
        turning=turning,
        cycle=_segment(turning, seen) // 2 + 1,
        stage_noise=noise,
    )


def _image_rows(log: Log) -> IntArray:
    """Rows of the images, which are numbered from 0 on."""
    rows = np.flatnonzero(np.isfinite(log.image))
    wrong = np.flatnonzero(log.image[rows] != np.arange(rows.size))
    if wrong.size:
        number, row = int(wrong[0]), int(rows[wrong[0]])
        expected = f"{number}, for images are numbered 0, 1, 2, …"
        raise log.error(row, "image", log.text(row, "image"), expected)
    return rows


def _load_of_images(log: Log, images: IntArray) -> FloatArray:
    """Return the load in the row of each image, else from the log between its neighbours [N]."""
    time, load = log.time, log.force
    loaded = np.flatnonzero(np.isfinite(load))
    force = load[images]
    for image in np.flatnonzero(np.isnan(force)).tolist():
        row = int(images[image])
        first = images[image - 1] if image else -1
        last = images[image + 1] if image + 1 < images.size else time.size
        near = loaded[(loaded > first) & (loaded < last)]
        if not (near.size and near[0] < row < near[-1]):
            expected = f"the load of image {image}, or loads logged shortly before and after it"
            raise log.error(row, "force", "nothing", expected)
        force[image] = np.interp(time[row], time[near], load[near])
    return force


def turning_points(stage: FloatArray, noise: float = 0.0) -> IntArray:
    """Rows of the first point, of each reversal (the end of its hold) and of the last point.

    Args:
        stage: stage travel [µm], shape (n_rows,).
        noise: its standard deviation [µm].
    """
    tolerance = max(REVERSAL * float(np.ptp(stage)), SIGNIFICANT * noise)
    turning, direction, best = [0], 0.0, 0
    for row in range(1, stage.size):
        if direction == 0.0:
            if abs(stage[row] - stage[0]) > tolerance:
                direction, best = math.copysign(1.0, stage[row] - stage[0]), row
        elif direction * (stage[row] - stage[best]) >= 0:
            best = row
        elif direction * (stage[best] - stage[row]) > tolerance:
            turning.append(best)
            direction, best = -direction, row
    turning.append(stage.size - 1)
    return np.array(turning, dtype=np.int64)


def phase_of_images(history: History) -> IntArray:
    """In which loading or unloading each image lies, from 0; the turning image ends its phase."""
    return _segment(history.turning, history.image_row)


def travel_told(history: History) -> str:
    """Return the reversals of the stage in words, and the noise above which they were sought."""
    turns = [f"{history.stage[row]:.4g}" for row in history.turning[1:-1]]
    shown = ", ".join(turns[:_TOLD]) + (", …" if len(turns) > _TOLD else "")
    said = f"the stage turns at {shown} µm" if turns else "the stage never turns"
    said = f"{said}; the test ends at {history.stage[-1]:.4g} µm after {history.time.size} instants"
    if history.stage_noise:
        least = SIGNIFICANT * history.stage_noise
        said += (
            f"; its travel has noise of {history.stage_noise:.2g} µm, so that it turns where it "
            f"goes back by more than {least:.2g} µm"
        )
    return said


def knot_weights(history: History) -> FloatArray:
    """Weights of the knots in each row: linear in stage travel between the turning points.

    A motion that is piecewise linear in stage travel, and constant where the stage holds, is
    ``weights @ knots``, with its values at the turning points as knots.

    Returns:
        Weights, each row summing to one, shape (n_rows, n_knots).
    """
    rows = np.arange(history.stage.size)
    segment = _segment(history.turning, rows)
    start = history.stage[history.turning[segment]]
    end = history.stage[history.turning[segment + 1]]
    share = np.clip((history.stage - start) / (end - start), 0.0, 1.0)
    weights = np.zeros((rows.size, history.n_knots))
    weights[rows, segment] = 1.0 - share
    weights[rows, segment + 1] = share
    return weights


def _segment(turning: IntArray, rows: IntArray) -> IntArray:
    """Between which turning points each row lies; a turning point ends its segment."""
    return np.maximum(np.searchsorted(turning, rows, side="left") - 1, 0)
