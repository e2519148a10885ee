"""Resultants from the table that Code_Aster prints (IMPR_TABLE, FORMAT='TABLEAU')."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from meshes.arrays import FloatArray
from solver_adapters.result_files import ResultFileError

_COMMENT = "#"
_SAME_INSTANT = 1e-6  # of the time, as Code_Aster compares instants


def read_resultants(path: Path, group: str, component: str, instants: FloatArray) -> FloatArray:
    """Resultant of a group of nodes along one axis.

    Args:
        path: the table, comma-separated, with the columns INTITULE, INST and the components.
        group: the nodes, as INTITULE names them.
        component: the column, as DY.
        instants: wanted times [s], shape (n_instants,).

    Returns:
        resultants [µN], shape (n_instants,).

    Raises:
        ResultFileError: the file is missing, empty, foreign or cut, or an instant is not in it.
    """
    what = f"the resultants of {group} that IMPR_TABLE writes"
    try:
        text = path.read_text(encoding="utf-8", errors="replace")
    except FileNotFoundError:
        raise ResultFileError(f"{path}: no such file; expected {what}") from None
    except OSError as error:
        raise ResultFileError(f"{path}: {error.strerror}; expected {what}") from None
    lines = (line for line in text.splitlines() if line.strip() and line[:1] != _COMMENT)
    try:
        rows = [[word.strip() for word in row] for row in csv.reader(lines)]
        head = rows[0]
        title, instant, value = (head.index(name) for name in ("INTITULE", "INST", component))
        table = np.array(
            [(float(row[instant]), float(row[value])) for row in rows[1:] if row[title] == group]
        ).reshape(-1, 2)
    except (IndexError, ValueError, csv.Error) as error:
        raise ResultFileError(f"{path}: found no such table ({error}); expected {what}") from None
    late = [
        time
        for time in instants
        if not (abs(table[:, 0] - time) <= _SAME_INSTANT * max(1.0, abs(time))).any()
    ]
    if late:
        raise ResultFileError(
            f"{path}: found {len(table)} instants of {group}; expected {late[0]:g} s and "
            f"{len(late) - 1} others too"
        )
    places = abs(table[:, 0] - instants[:, None]).argmin(axis=1)
    return np.asarray(table[places, 1])
