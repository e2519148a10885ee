"""Times, stage travel, images and loads of a log, in the units of prismid."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from driver.case.history import (
    CLOCK,
    MICROMETRES,
    NEWTONS,
    SECONDS,
    HistoryTable,
    ImageColumn,
)
from driver.common.errors import sentence, show
from driver.experiment.log_advice import (
    column_entry,
    entry_with_unit,
    remedy_of_names,
    same_unit,
    unit_in,
    unit_in_row,
)
from driver.experiment.log_file import (
    HistoryError,
    LogRow,
    log_lines,
    names_of,
    rows_of,
)
from meshes.arrays import FloatArray

_LONGEST = 200  # characters of a row that are told
_PLAIN = frozenset("0123456789+-.eE")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_WITH_COMMA = re.compile(r"[+-]?(\d+,\d*|,\d+)([eE][+-]?\d+)?")
_CLOCK_TIME = re.compile(r"(\d+):([0-5]?\d):([0-5]?\d(\.\d*)?)")


@dataclass(frozen=True)
class LogColumn:
    """A column of a log.

    Attributes:
        kind: "time", "stage", "image" or "force".
        name: as the file has it.
        place: its number, from 0 on.
        unit: as the case states it, None where it has none.
    """

    kind: str
    name: str
    place: int
    unit: str | None

    def entry(self, unit: str | None) -> str:
        """Return the line of the case that would state another unit."""
        return entry_with_unit(self.kind, self.name, self.place + 1, unit)


@dataclass(frozen=True, eq=False)
class Log:
    """What a log holds, n rows; not a number where a cell has no value.

    Attributes:
        path: the file.
        columns: those that were read, by kind.
        rows: their texts.
        time: instants [s], shape (n,).
        stage: stage travel [µm], shape (n,).
        image: numbers of the images, shape (n,).
        force: macroscopic loads [N], shape (n,).
    """

    path: Path
    columns: Mapping[str, LogColumn]
    rows: Sequence[LogRow]
    time: FloatArray
    stage: FloatArray
    image: FloatArray
    force: FloatArray

    def text(self, row: int, kind: str) -> str:
        """Return what stands in a cell."""
        return self.rows[row].cells[self.columns[kind].place]

    def error(self, row: int, kind: str, found: str, expected: str) -> HistoryError:
        """Return the error about a cell."""
        place = f"row {self.rows[row].number}, {self.columns[kind].name}"
        return HistoryError(sentence(self.path, place, found, expected))


def read_log(path: Path, stated: HistoryTable, needed: Sequence[str]) -> Log:
    """Read the columns of a log.

    Args:
        path: the file.
        stated: how it is written.
        needed: kinds of columns that have to be there, of "time", "stage", "image" and "force";
            that of the loads is read where it is there.

    Raises:
        HistoryError: the file cannot be read as stated; the sentence says what the case would
            have to state.
    """
    lines = log_lines(path, stated)
    names = names_of(path, lines, stated)
    columns: dict[str, LogColumn] = {}
    for kind in dict.fromkeys((*needed, "force")):
        column = _column(path, stated, names, kind)
        if column is not None:
            columns[kind] = column
        elif kind in needed:
            raise _no_column(path, stated, names, lines, kind, needed)
    _refuse_other_units(path, stated, lines, columns)
    rows = rows_of(path, lines, stated, len(names))
    for column in columns.values():
        if rows and column.place >= len(rows[0].cells):
            found, expected = f"{len(rows[0].cells)} columns", f"a column {column.place + 1}"
            raise HistoryError(sentence(path, f"history.columns.{column.kind}", found, expected))
    _refuse_no_numbers(path, stated, lines, rows, columns)

    def values(kind: str, unit: float) -> FloatArray:
        if kind not in columns:
            return np.full(len(rows), np.nan)
        return unit * _values(path, stated, columns[kind], rows)

    return Log(
        path=path,
        columns=columns,
        rows=rows,
        time=values("time", SECONDS.get(stated.time.unit, 1.0)),
        stage=values("stage", MICROMETRES[stated.stage.unit]),
        image=values("image", 1.0),
        force=values("force", NEWTONS[stated.force.unit]),
    )


def _column(path: Path, stated: HistoryTable, names: Sequence[str], kind: str) -> LogColumn | None:
    """Return a column, None where the file has none of that name.

    Raises:
        HistoryError: the name stands at several columns.
    """
    column: ImageColumn = getattr(stated, kind)
    unit = getattr(column, "unit", None)
    if isinstance(column.name, int):
        place = column.name - 1
        name = names[place] if place < len(names) else f"column {column.name}"
        return LogColumn(kind, name, place, unit)
    places = [place for place, name in enumerate(names) if name == column.name]
    if len(places) > 1:
        entry = column_entry(kind, places[0] + 1, unit)
        found = f"the column {column.name} {len(places)} times"
        expected = f"each column once, or its number, as {entry} under [history.columns]"
        raise HistoryError(sentence(path, f"row {stated.header_row}", found, expected))
    return LogColumn(kind, column.name, places[0], unit) if places else None


def _no_column(
    path: Path,
    stated: HistoryTable,
    names: Sequence[str],
    lines: Sequence[str],
    kind: str,
    needed: Sequence[str],
) -> HistoryError:
    column: ImageColumn = getattr(stated, kind)
    if not names:
        entry = column_entry(kind, 1, getattr(column, "unit", None))
        expected = f"a number with header_row = 0, as {entry} under [history.columns]"
        found = f'the name "{column.name}"'
        return HistoryError(sentence(path, f"history.columns.{kind}", found, expected))
    found = stated.separator.join(names)
    if len(found) > _LONGEST:
        found = f"{found[:_LONGEST]}…"
    expected = f"the column {column.name}, or {remedy_of_names(lines, stated, needed)}"
    return HistoryError(sentence(path, f"row {stated.header_row}", found, expected))


def _refuse_other_units(
    path: Path, stated: HistoryTable, lines: Sequence[str], columns: Mapping[str, LogColumn]
) -> None:
    """Refuse a column of which its name, or a row below the names, says another unit."""
    for kind, column in columns.items():
        if isinstance(getattr(stated, kind).name, int):
            continue
        said = _units_said(stated, lines, column)
        for number, unit in said.items():
            if unit is not None and not same_unit(unit, column.unit):
                found = f'the column {column.name} in "{unit}"'
                expected = (
                    f'"{column.unit}", or {column.entry(unit)} under [history.columns] (a column '
                    f"that tells a wrong unit is stated by its number, name = {column.place + 1})"
                )
                raise HistoryError(sentence(path, f"row {number}", found, expected))


def _units_said(
    stated: HistoryTable, lines: Sequence[str], column: LogColumn
) -> Mapping[int, str | None]:
    """Return what the name of a column and the rows below the names say of its unit, by the row."""
    last = min(stated.first_data_row - 1, len(lines))
    below = range(stated.header_row, last) if stated.header_row else ()
    return {stated.header_row: unit_in(column.name, column.kind)} | {
        row + 1: unit_in_row(lines[row], stated.separator, column.place, column.kind)
        for row in below
    }


def tells_unit(path: Path, stated: HistoryTable, kind: str) -> bool:
    """Whether a log itself says in which unit a column is, right or wrong.

    Args:
        path: the file.
        stated: how it is written.
        kind: "time", "stage" or "force".

    Raises:
        HistoryError: the file cannot be read as stated.
    """
    lines = log_lines(path, stated)
    column = _column(path, stated, names_of(path, lines, stated), kind)
    return column is not None and any(_units_said(stated, lines, column).values())


def _refuse_no_numbers(
    path: Path,
    stated: HistoryTable,
    lines: Sequence[str],
    rows: Sequence[LogRow],
    columns: Mapping[str, LogColumn],
) -> None:
    """Refuse a log without rows, and a first row without any digit: it speaks of the columns."""
    if not rows:
        raise HistoryError(sentence(path, "file", "no rows of numbers", "one for each instant"))
    first = rows[0]
    texts = [first.cells[columns[kind].place] for kind in ("time", "stage")]
    if any(any(c.isdigit() for c in text) or not text for text in texts):
        return
    line, separator = lines[first.number - 1], stated.separator
    units = {kind: unit_in_row(line, separator, c.place, kind) for kind, c in columns.items()}
    entries = [
        columns[kind].entry(unit)
        for kind, unit in units.items()
        if unit is not None and not same_unit(unit, columns[kind].unit)
    ]
    remedy = f"first_row = {first.number + 1} under [history]"
    if entries:
        remedy += f" and {', '.join(entries)} under [history.columns]"
    found = show(stated.separator.join(first.cells))
    raise HistoryError(sentence(path, f"row {first.number}", found, f"numbers, or {remedy}"))


def _values(
    path: Path, stated: HistoryTable, column: LogColumn, rows: Sequence[LogRow]
) -> FloatArray:
    """Return the numbers of a column, NaN where an image or a load may be absent and is."""
    texts = [row.cells[column.place] for row in rows]
    absent = {"", stated.empty} if column.kind in ("image", "force") else set()
    if column.unit != CLOCK and stated.decimal == "." and _PLAIN.issuperset("".join(texts)):
        # Most logs, at once; what is no number after all is told below, with its row.
        with suppress(ValueError):
            values = np.array([math.nan if text in absent else float(text) for text in texts])
            if not np.isinf(values).any():
                return values
    return np.array([_value(path, stated, column, row) for row in rows])


def _value(path: Path, stated: HistoryTable, column: LogColumn, row: LogRow) -> float:
    """Return the number of a cell, NaN where an image or a load may be absent and is."""
    text = row.cells[column.place]
    if column.kind in ("image", "force") and text in ("", stated.empty):
        return math.nan
    pointed = text
    if stated.decimal == ",":
        pointed = "" if "." in text else text.replace(",", ".")
    if column.unit == CLOCK:
        if match := _CLOCK_TIME.fullmatch(pointed):
            return 3600.0 * int(match[1]) + 60.0 * int(match[2]) + float(match[3])
    elif _NUMBER.fullmatch(pointed) and math.isfinite(float(pointed)):
        return float(pointed)
    found = show(text) if text else "nothing"
    place = f"row {row.number}, {column.name}"
    raise HistoryError(sentence(path, place, found, _expected(stated, column, text)))


def _expected(stated: HistoryTable, column: LogColumn, text: str) -> str:
    """Say what a cell should hold, and what would have it read as it is."""
    if column.unit == CLOCK:
        return f"a time as {CLOCK}"
    if column.kind == "time" and re.fullmatch(r"\d+:\d+:\d+([.,]\d*)?", text):
        return f"a number, or {column.entry(CLOCK)} under [history.columns]"
    if stated.decimal == "." and _WITH_COMMA.fullmatch(text):
        return 'a number, or decimal = "," under [history]'
    if stated.decimal == "," and "." in text:
        return 'a number without a point, for decimal = "," under [history]'
    if column.kind in ("image", "force") and text and not any(c.isdigit() for c in text):
        return f"a number or nothing, or empty = {show(text)} under [history]"
    return "a number"
