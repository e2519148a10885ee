"""The loading history: times, stage travel, images and loads, its cycles and its knots."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from driver.common.errors import InputError, sentence, show, why
from meshes.arrays import BoolArray, FloatArray, IntArray

_BEYOND = "beyond the columns"
_MOST_BYTES = 50_000_000  # of a file, some million rows
COLUMNS = ("time_s", "stage_um", "image", "force_N")
# The stage has turned when it has gone back by this share of its whole range: less is play
# or encoder noise.
_REVERSAL = 0.02
# A row that only logs a load is left out where the travel is straight within this share.
_STRAIGHT = 0.002


class HistoryError(InputError):
    """A loading history that cannot be used: file, row, what was found, what was expected."""


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
    """

    time: FloatArray
    stage: FloatArray
    image_row: IntArray
    force: FloatArray
    turning: IntArray
    cycle: IntArray

    @property
    def n_images(self) -> int:
        """Number of images."""
        return self.image_row.size

    @property
    def n_knots(self) -> int:
        """Number of turning points."""
        return self.turning.size


def read_history(path: Path, with_images: bool = True, with_loads: bool = True) -> History:
    """Read a history of columns time_s, stage_um, image, force_N.

    A row with a load but no image belongs to a log of loads. The load of an image that has none
    in its own row lies on the line between the loads logged before and after it. A row of the
    log is an instant of the history only where the stage travel bends.

    Args:
        path: the file.
        with_images: whether the images are read; if not, each load stands for itself, and the
            column of the images is not looked at.
        with_loads: whether the loads are needed; else they may be absent, and are 0.

    Raises:
        HistoryError: the file is absent, a column is missing, a cell is no number, times do not
            increase, images are not numbered 0, 1, 2, …, an image has no load, there are fewer
            than two images (loads), or the stage never moves.
    """
    rows = _read_rows(path, COLUMNS if with_loads else COLUMNS[:-1])
    time = np.array([_number(path, row, "time_s") for row in rows])
    stage = np.array([_number(path, row, "stage_um") for row in rows])
    for index in range(1, len(rows)):
        if time[index] <= time[index - 1]:
            found, before = rows[index]["time_s"], rows[index - 1]["time_s"]
            raise _error(path, rows[index], "time_s", found, f"more than the {before} s before it")
    loaded = np.array([bool(row.get("force_N")) for row in rows], dtype=bool)
    load = np.full(len(rows), np.nan)
    load[loaded] = [_number(path, row, "force_N") for row in np.array(rows)[loaded]]
    seen = _image_rows(path, rows) if with_images else np.flatnonzero(loaded)
    if seen.size < 2:
        column, what = ("image", "images") if with_images else ("force_N", "loads")
        least = "image 0 and at least one more" if with_images else "at least two"
        raise HistoryError(sentence(path, column, f"{seen.size} {what}", least))
    if np.ptp(stage) == 0:
        raise HistoryError(
            sentence(path, "stage_um", f"{stage[0]:g} in every row", "a stage that moves")
        )
    force = np.nan_to_num(load[seen])
    if with_loads:
        force = _load_of_images(path, rows, time, load, seen)
    stated = ~loaded
    stated[seen] = True
    kept = _instants(time, stage, stated)
    time, stage, seen = time[kept], stage[kept], np.searchsorted(kept, seen)
    turning = turning_points(stage)
    return History(
        time=time,
        stage=stage,
        image_row=seen,
        force=force,
        turning=turning,
        cycle=_segment(turning, seen) // 2 + 1,
    )


def _image_rows(path: Path, rows: list[dict[str, str]]) -> IntArray:
    rows_of_images: list[int] = []
    for index, row in enumerate(rows):
        if not row["image"]:
            continue
        number = len(rows_of_images)
        # A column with gaps is one of floating-point numbers in pandas.
        if row["image"] not in (f"{number}", f"{number}.0"):
            raise _error(path, row, "image", row["image"],
                         f"{number}, for images are numbered 0, 1, 2, …")  # fmt: skip
        rows_of_images.append(index)
    return np.array(rows_of_images, dtype=np.int64)


def _load_of_images(
    path: Path, rows: list[dict[str, str]], time: FloatArray, load: FloatArray, images: IntArray
) -> FloatArray:
    """Return the load in the row of each image, else from the log between its neighbours [N]."""
    loaded = np.flatnonzero(np.isfinite(load))
    force = load[images]
    for image in np.flatnonzero(np.isnan(force)).tolist():
        row = images[image]
        first = images[image - 1] if image else -1
        last = images[image + 1] if image + 1 < images.size else len(rows)
        near = loaded[(loaded > first) & (loaded < last)]
        if not (near.size and near[0] < row < near[-1]):
            expected = f"the load of image {image}, or loads logged shortly before and after it"
            raise _error(path, rows[row], "force_N", "nothing", expected)
        force[image] = np.interp(time[row], time[near], load[near])
    return force


def _instants(time: FloatArray, stage: FloatArray, stated: BoolArray) -> IntArray:
    """Rows that are stated instants, and those of the log at which the stage travel bends."""
    kept = stated.copy()
    kept[[0, -1]] = True
    tolerance = _STRAIGHT * np.ptp(stage)
    while True:
        rows = np.flatnonzero(kept)
        off = np.abs(stage - np.interp(time, time[rows], stage[rows]))
        worst = [a + int(np.argmax(off[a:b])) for a, b in pairwise(rows.tolist())]
        bends = [row for row in worst if off[row] > tolerance]
        if not bends:
            return rows
        kept[bends] = True


def turning_points(stage: FloatArray) -> IntArray:
    """Rows of the first point, of each reversal (the end of its hold) and of the last point.

    Args:
        stage: stage travel [µm], shape (n_rows,).
    """
    tolerance = _REVERSAL * np.ptp(stage)
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


def _read_rows(path: Path, columns: Sequence[str]) -> list[dict[str, str]]:
    """Return the rows with their line number under the key "line"; `columns` have to be there."""
    try:
        _refuse_no_table(path)
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.DictReader(file, restkey=_BEYOND, skipinitialspace=True)
            names = [name.strip() for name in reader.fieldnames or ()]
            reader.fieldnames = names
            missing = [name for name in columns if name not in names]
            if missing:
                found = ",".join(names) or "no columns"
                raise HistoryError(sentence(path, "row 1", found, "the column " + missing[0]))
            twice = [name for name in columns if names.count(name) > 1]
            if twice:
                found = f"the column {twice[0]} {names.count(twice[0])} times"
                raise HistoryError(sentence(path, "row 1", found, "each column once"))
            return [_cells(path, row, names, reader.line_num) for row in reader]
    except FileNotFoundError:
        expected = "a CSV file of " + ", ".join(COLUMNS)
        raise HistoryError(sentence(path, "file", "nothing", expected)) from None
    except HistoryError:
        raise
    except UnicodeDecodeError as error:
        raise HistoryError(sentence(path, "file", f"“{error}”", "a text in UTF-8")) from None
    except (OSError, ValueError, csv.Error) as error:
        expected = "a CSV file of " + ", ".join(COLUMNS)
        raise HistoryError(sentence(path, "history.file", why(error), expected)) from None


def _refuse_no_table(path: Path) -> None:
    """Refuse what has no end, as a pipe or a device, and what no log of a test is as large as."""
    expected = f"a CSV file of at most {_MOST_BYTES / 1e6:.0f} MB"
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise HistoryError(sentence(path, "file", "no regular file", expected))
    if path.is_file() and path.stat().st_size > _MOST_BYTES:
        found = f"{path.stat().st_size / 1e6:.0f} MB"
        raise HistoryError(sentence(path, "file", found, expected))


def _cells(path: Path, row: Mapping[str, Any], names: Sequence[str], line: int) -> dict[str, str]:
    """Strip the cells of a row; more cells than columns are decimal commas, or a slip."""
    more: Sequence[str] = row.get(_BEYOND, ())
    if any(cell.strip() for cell in more):
        found = f"{len(names) + len(more)} cells"
        expected = f"{len(names)}, as the columns, parted by commas, with points in the numbers"
        raise HistoryError(sentence(path, f"row {line}", found, expected))
    cells = {name: (row[name] or "").strip() for name in COLUMNS if name in names}
    if any("\n" in cell for cell in cells.values()):
        found = "a cell that goes on in the next row"
        raise HistoryError(sentence(path, f"row {line}", found, "each quote closed in its row"))
    return cells | {"line": str(line)}


def _number(path: Path, row: dict[str, str], column: str) -> float:
    text = row[column]
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise _error(path, row, column, show(text) if text else "nothing", "a number")
    return value


def _error(path: Path, row: dict[str, str], column: str, found: str, expected: str) -> HistoryError:
    return HistoryError(sentence(path, f"row {row['line']}, {column}", found, expected))
