"""What to write in the case to have a log read whose table is not the stated one."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from driver.case.history import CLOCK, MICROMETRES, NEWTONS, SECONDS, HistoryTable
from driver.common.errors import show
from driver.experiment.log_file import cells_of

_SEARCHED = 200  # first rows, among which the names of the columns are looked for
_BRACKETS = re.compile(r"[\[(<]\s*([^\])>]+?)\s*[\])>]\s*$")
_LAST_WORD = re.compile(r"[\s_/,.]([^\s_/,.\d]+)$")
_MICRO = "\u00b5"
_WORDS = {
    "time": re.compile(r"time|zeit|temps|^t\b", re.I),
    "stage": re.compile(r"stage|travel|displ|position|crosshead|weg|extension|stroke", re.I),
    "image": re.compile(r"image|frame|picture|photo|bild|^img", re.I),
    "force": re.compile(r"force|load|kraft|^f\b", re.I),
}
UNITS: Mapping[str, Sequence[str]] = {
    "time": (*SECONDS, CLOCK), "stage": tuple(MICROMETRES), "image": (), "force": tuple(NEWTONS),
}  # fmt: skip
_USUAL_UNITS = {
    "time": ("s", "min", CLOCK),
    "stage": ("um", "nm", "mm"),
    "force": ("N", "mN", "kN"),
}
_OTHER_SPELLINGS = {"sec": "s", "seconds": "s", "minutes": "min", "hours": "h", "micron": "um"}


@dataclass(frozen=True)
class _Header:
    row: int
    separator: str
    columns: Mapping[str, str]


def unit_in(name: str, kind: str) -> str | None:
    """Return the unit that the name of a column states, None where it states none of its kind.

    Args:
        name: of the column, as "Time [min]" or "stage_mm".
        kind: "time", "stage", "image" or "force".
    """
    for pattern in (_BRACKETS, _LAST_WORD):
        if match := pattern.search(name):
            unit = match[1].replace("\u03bc", _MICRO)
            unit = _OTHER_SPELLINGS.get(unit.lower(), unit)
            if unit in UNITS[kind]:
                return unit
    return None


def unit_in_row(line: str, separator: str, place: int, kind: str) -> str | None:
    """Return the unit that a row of units states for a column, None where it states none.

    Args:
        line: the row.
        separator: between its cells.
        place: number of the column, from 0 on.
        kind: "time", "stage", "image" or "force".
    """
    try:
        cells = cells_of(line, separator)
    except csv.Error:
        return None
    return unit_in(f"[{cells[place].strip('[]()')}]", kind) if place < len(cells) else None


def entry_with_unit(kind: str, name: str, number: int, unit: str | None) -> str:
    """Return the line that states a column of a unit, by its number where its name says another.

    Args:
        kind: "time", "stage", "image" or "force".
        name: of the column.
        number: of the column, from 1 on.
        unit: of the column, None where it is not known.
    """
    said = unit_in(name, kind)
    return column_entry(kind, name if said is None or same_unit(said, unit) else number, unit)


def same_unit(one: str | None, other: str | None) -> bool:
    """Whether two units are one, in whatever spelling."""
    return str(one).replace(_MICRO, "u") == str(other).replace(_MICRO, "u")


def column_entry(kind: str, name: str | int, unit: str | None) -> str:
    """Return the line of [history.columns] that states a column."""
    if not UNITS[kind]:
        return f"{kind} = {{name = {show(name)}}}"
    said = show(unit) if unit else " or ".join(show(known) for known in _USUAL_UNITS[kind])
    return f"{kind} = {{name = {show(name)}, unit = {said}}}"


def remedy_of_names(lines: Sequence[str], stated: HistoryTable, needed: Sequence[str]) -> str:
    """Say what would have the columns of a log found, or that names have to be stated.

    Args:
        lines: of the log.
        stated: how the case says that it is written.
        needed: kinds of columns that were sought.
    """
    header = _header(lines, stated, needed)
    if header is None and _digits_alone(lines[stated.header_row - 1]):
        return (
            f"header_row = 0 under [history] and {column_entry('time', 1, None)}, … under "
            "[history.columns], for names that are not there"
        )
    if header is None:
        return (
            f"the names of its columns as {column_entry('time', 'Time', 'min')} under "
            "[history.columns], or its separator and header_row under [history]"
        )
    keys = []
    if header.separator != stated.separator:
        keys.append(f"separator = {show(header.separator)}")
    if header.row != stated.header_row:
        keys.append(f"header_row = {header.row}")
    numbers = _first_numbers(lines, header)
    if numbers is not None and numbers != (stated.first_row or header.row + 1):
        keys.append(f"first_row = {numbers}")
    entries = []
    for kind in needed:
        name = header.columns.get(kind)
        if name is None:
            entries.append(column_entry(kind, "…", None))
        elif name != getattr(stated, kind).name:
            unit = unit_in(name, kind) or _unit_below(lines, header, numbers, kind)
            entries.append(column_entry(kind, name, unit))
    said = []
    if keys:
        said.append(f"{', '.join(keys)} under [history]")
    if entries:
        said.append(f"{', '.join(entries)} under [history.columns]")
    return " and ".join(said)


def _header(lines: Sequence[str], stated: HistoryTable, needed: Sequence[str]) -> _Header | None:
    """Return the row that names most of the columns, as the case states them or as is usual."""
    found = [
        _Header(row, separator, columns)
        for row, separator, cells in _candidates(lines, stated)
        if len(columns := _columns(cells, stated, needed)) > 1
    ]
    return max(found, key=lambda header: len(header.columns), default=None)


def _columns(
    cells: Sequence[str], stated: HistoryTable, needed: Sequence[str]
) -> Mapping[str, str]:
    """Return which cells may be names of columns, each of one at most."""
    columns: dict[str, str] = {}
    for kind in needed:
        if (name := getattr(stated, kind).name) in cells:
            columns[kind] = name
    for kind in needed:
        likely = (c for c in cells if _WORDS[kind].search(c) and c not in columns.values())
        if kind not in columns and (name := next(likely, None)) is not None:
            columns[kind] = name
    return columns


def _candidates(lines: Sequence[str], stated: HistoryTable) -> Iterator[tuple[int, str, list[str]]]:
    separators = dict.fromkeys((stated.separator, ",", ";", "\t", "|", " "))
    for row, line in enumerate(lines[:_SEARCHED], 1):
        for separator in separators:
            try:
                yield row, separator, cells_of(line, separator)
            except csv.Error:
                continue


def _unit_below(
    lines: Sequence[str], header: _Header, numbers: int | None, kind: str
) -> str | None:
    """Return the unit that a row between the names and the numbers states for a column."""
    place = cells_of(lines[header.row - 1], header.separator).index(header.columns[kind])
    for line in lines[header.row : (numbers or header.row + 1) - 1]:
        unit = unit_in_row(line, header.separator, place, kind)
        if unit is not None:
            return unit
    return None


def _digits_alone(line: str) -> bool:
    return any(c.isdigit() for c in line) and not any(c.isalpha() for c in line)


def _first_numbers(lines: Sequence[str], header: _Header) -> int | None:
    """Return the first row below the names that begins with a digit, of those next to them."""
    for row in range(header.row + 1, min(header.row + 6, len(lines) + 1)):
        text = lines[row - 1].strip().lstrip('"+-')
        if text[:1].isdigit():
            return row
    return None
