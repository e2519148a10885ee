"""What is wrong with a text file of a map that its reader cannot read."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

from driver.common.errors import show
from driver.experiment.ebsd.headers import ANG, CTF_COLUMNS
from driver.experiment.images.files import Refused

_DECIMAL = 'numbers with "." as decimal sign'


def text_fault(file: Path) -> Refused | None:
    """Return the first fault of an .ang or .ctf file, None where its rows are sound.

    Args:
        file: the file.

    Raises:
        OSError: it cannot be read.
    """
    ang, columns = file.suffix.lower() == ANG, 0
    whole = f"{'an' if ang else 'a'} {file.suffix.lower()} file that is whole: export it anew"
    with file.open(encoding="utf-8", errors="replace") as text:
        for number, line in _rows(text, ang):
            cells = line.split()
            columns = columns or len(cells)
            wrong = next((cell for cell in cells if not _is_number(cell, ang)), None)
            if wrong is not None:
                comma = _is_number(wrong.replace(",", "."), ang)
                return Refused(f"{show(wrong[:40])} in line {number}", _DECIMAL if comma else whole)
            if len(cells) != columns:
                found = f"{len(cells)} of {columns} columns in line {number}"
                return Refused(found, whole)
    return None if columns else Refused("no points", whole)


def _rows(text: Iterator[str], ang: bool) -> Iterator[tuple[int, str]]:
    """Yield the rows of points with the numbers of their lines."""
    header = not ang
    for number, line in enumerate(text, start=1):
        if header:
            header = not line.startswith(CTF_COLUMNS)
        elif line.strip() and not (ang and line.startswith("#")):
            yield number, line


def _is_number(cell: str, ang: bool) -> bool:
    try:
        return math.isfinite(float(cell if ang else cell.replace(",", ".")))
    except ValueError:
        return False
