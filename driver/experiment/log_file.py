"""The table of a log in a text file, read as the case states it: cells by row and column."""

from __future__ import annotations

import codecs
import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from driver.case.history import HistoryTable
from driver.common.errors import InputError, sentence, show, why
from driver.common.file_kinds import EMPTY, kind_by_content

_MOST_BYTES = 50_000_000  # of a file, some million rows
_END_OF_LINE = re.compile("\r\n|\r|\n")
# Marks at the beginning of a file that say which encoding it has.
_MARKS = (
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)


class HistoryError(InputError):
    """A loading history that cannot be used: file, row, what was found, what was expected."""


@dataclass(frozen=True)
class LogRow:
    """A row of a log.

    Attributes:
        number: its number in the file, from 1 on.
        cells: its texts, as many as there are columns.
    """

    number: int
    cells: tuple[str, ...]


def log_lines(path: Path, stated: HistoryTable) -> list[str]:
    """Return the lines of a log.

    Raises:
        HistoryError: the file is absent, no text, or of another encoding.
    """
    expected = "a CSV file of time_s, stage_um, image, force_N"
    try:
        _refuse_no_table(path)
        if path.is_file() and (kind := kind_by_content(path)) and kind != EMPTY:
            raise HistoryError(sentence(path, "file", kind, f"{expected}: save its table as text"))
        content = path.read_bytes()
    except HistoryError:
        raise
    except FileNotFoundError:
        raise HistoryError(sentence(path, "file", "nothing", expected)) from None
    except (OSError, ValueError) as error:
        raise HistoryError(sentence(path, "history.file", why(error), expected)) from None
    return _END_OF_LINE.split(_decoded(path, content, stated.encoding))


def cells_of(line: str, separator: str) -> list[str]:
    """Return the cells of a line without the blanks around them.

    Raises:
        csv.Error: a quote is not closed.
    """
    if separator == " ":
        line = " ".join(line.split())
    if '"' in line:
        (cells,) = csv.reader([line], delimiter=separator, skipinitialspace=True, strict=True)
    else:
        cells = line.split(separator)
    return [cell.strip() for cell in cells]


def names_of(path: Path, lines: Sequence[str], stated: HistoryTable) -> tuple[str, ...]:
    """Return the names of the columns of a log, none where it has no row of them.

    Args:
        path: the file.
        lines: its lines.
        stated: how it is written.

    Raises:
        HistoryError: nothing stands in the row of the names.
    """
    number = stated.header_row
    if not number:
        return ()
    names = _cells(path, number, lines[number - 1] if number <= len(lines) else "", stated)
    while names and not names[-1]:
        names.pop()
    if not names:
        expected = "the names of the columns"
        raise HistoryError(sentence(path, f"row {number}", "no columns", expected))
    return tuple(names)


def rows_of(path: Path, lines: Sequence[str], stated: HistoryTable, width: int) -> list[LogRow]:
    """Return the rows of numbers of a log, without those in which nothing stands.

    Args:
        path: the file.
        lines: its lines.
        stated: how it is written.
        width: number of its columns, 0 for that of the first row.

    Raises:
        HistoryError: a row has other cells than columns, or an open quote.
    """
    rows: list[LogRow] = []
    for number, line in enumerate(lines[stated.first_data_row - 1 :], stated.first_data_row):
        cells = _cells(path, number, line, stated)
        if any(cells):
            width = width or len(cells)
            rows.append(LogRow(number, _as_wide(path, number, cells, width, stated)))
    return rows


def _cells(path: Path, number: int, line: str, stated: HistoryTable) -> list[str]:
    try:
        return cells_of(line, stated.separator)
    except csv.Error:
        found, expected = "a quote that stays open", "each quote closed in its row"
        raise HistoryError(sentence(path, f"row {number}", found, expected)) from None


def _as_wide(
    path: Path, number: int, cells: Sequence[str], width: int, stated: HistoryTable
) -> tuple[str, ...]:
    """Return as many cells as there are columns: empty ones at the end may lack or be too many."""
    more = any(cells[width:])
    # Between blanks nothing can stand, so that one does not know which cell a short row lacks.
    if more or (stated.separator == " " and len(cells) != width):
        expected = (
            f"{width}, as the columns, parted by {show(stated.separator)}, with "
            f"{show(stated.decimal)} in the numbers"
        )
        if stated.separator == ",":
            expected += " (numbers with decimal commas need another separator)"
        raise HistoryError(sentence(path, f"row {number}", f"{len(cells)} cells", expected))
    return (*cells[:width], *([""] * (width - len(cells))))


def _refuse_no_table(path: Path) -> None:
    """Refuse what has no end, as a pipe or a device, and what no log of a test is as large as."""
    expected = f"a CSV file of at most {_MOST_BYTES / 1e6:.0f} MB"
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise HistoryError(sentence(path, "file", "no regular file", expected))
    if path.is_file() and path.stat().st_size > _MOST_BYTES:
        found = f"{path.stat().st_size / 1e6:.0f} MB"
        raise HistoryError(sentence(path, "file", found, expected))


def _decoded(path: Path, content: bytes, encoding: str) -> str:
    """Return the text of a file; another encoding than the stated one is told."""

    def error(place: str, found: str, remedy: str) -> HistoryError:
        expected = f"a text in {encoding.upper()}, or {remedy} under [history]"
        return HistoryError(sentence(path, place, found, expected))

    name = codecs.lookup(encoding).name
    for mark, marked in _MARKS:
        if content.startswith(mark) and not name.startswith(marked):
            raise error("file", f"the mark of {marked.upper()}", f'encoding = "{marked}"')
    try:
        text = content.decode("utf-8-sig" if name == "utf-8" else encoding)
    except UnicodeDecodeError as reason:
        number = content.count(b"\n", 0, reason.start) + 1
        found = f"the byte 0x{content[reason.start]:02x}"
        remedy = '"latin-1"' if name == "cp1252" else '"cp1252" (Windows)'
        raise error(f"row {number}", found, f"encoding = {remedy}") from None
    except UnicodeError as reason:
        raise error("file", why(reason), 'encoding = "utf-8"') from None
    if "\0" in text[:1000]:
        raise error("file", "characters of two bytes", 'encoding = "utf-16-le"')
    return text.removeprefix("\ufeff")
