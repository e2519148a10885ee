"""Sums of reactions from the printed results (.dat)."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from solver_adapters.calculix.text import read_text
from solver_adapters.interface import FloatArray
from solver_adapters.result_files import ResultFileError

_TOTAL = re.compile(
    r"total force \(fx,fy,fz\) for set (\S+) and time +(\S+)\s*\n\s*\n +(\S+) +(\S+) +(\S+)[ ]*\n"
)
_TIME = 1e-6  # of a printed instant, which has seven digits


def read_force(path: Path, name: str, instants: FloatArray) -> FloatArray:
    """Sum of the reactions of a node set; the file has seven digits of it.

    Args:
        path: the .dat file.
        name: the node set.
        instants: the wanted instants since the start of the run [s], shape (n_instants,).

    Returns:
        force [µN], shape (n_instants, 3).

    Raises:
        ResultFileError: the file is missing, empty or foreign, or an instant is not in it.
    """
    what = f"the reactions of {name}"
    text = read_text(path, what)
    found = [match.groups() for match in _TOTAL.finditer(text)]
    if not found:
        raise ResultFileError(f"{path.name}: found no sum of reactions, expected {what}")
    others = {row[0] for row in found} - {name}
    if others:
        raise ResultFileError(f"{path.name}: found the set {min(others)}, expected {what}")
    try:
        table = np.array([row[1:] for row in found], dtype=np.float64)
    except ValueError as error:
        raise ResultFileError(f"{path.name}: {error}, expected {what}") from None
    times = table[:, 0]
    for row, instant in enumerate(instants):
        if row >= len(times) or abs(times[row] - instant) > _TIME * max(instant, times[row]):
            raise ResultFileError(
                f"{path.name}: found no sum of reactions at {instant:g} s (it has {len(times)} "
                f"instants up to {times[-1]:g} s), expected {len(instants)}"
            )
    return table[: len(instants), 1:]
