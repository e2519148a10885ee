"""Increments from the status file (.sta), of a run that has ended or goes on."""

from __future__ import annotations

import re
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from meshes.arrays import FloatArray
from solver_adapters.calculix.text import read_text
from solver_adapters.result_files import ResultFileError

# Step, increment, attempt (with U where it failed), iterations, total time, step time, length.
_ROW = re.compile(r"^ +(\d+) +(\d+) +(\d+)(U?) +(\d+) +(\S+) +(\S+) +(\S+) *$", re.MULTILINE)


@dataclass(frozen=True, eq=False)
class Increments:
    """How a run went.

    Attributes:
        ends: ends of the increments since the first instant [s], shape (n_increments,).
        iterations: Newton iterations, those of failed attempts included.
        cuts: attempts that failed.
    """

    ends: FloatArray
    iterations: int
    cuts: int


def reached(path: Path) -> float | None:
    """Return the end of the last increment so far, since the start [s], None before one."""
    try:
        rows = _ROW.findall(path.read_text(encoding="ascii", errors="replace"))
    except OSError:
        return None
    # A row of a file that grows may break off.
    with suppress(ValueError):
        taken = [float(row[5]) for row in rows if not row[3]]
        return taken[-1] if taken else None
    return None


def read_increments(path: Path, ends: FloatArray) -> Increments:
    """Return the increments of a run.

    Args:
        path: the .sta file.
        ends: ends of the *STEPs since the start of the run [s]; the file has seven digits of them.

    Raises:
        ResultFileError: the file is missing, empty, foreign, or ends before the last *STEP.
    """
    text = read_text(path, "the increments of CalculiX")
    rows = _ROW.findall(text)
    if not text.startswith("SUMMARY OF JOB INFORMATION") or not rows:
        raise ResultFileError(
            f"{path.name}: found a file that begins with {text[:20]!r}, expected the increments "
            "of CalculiX"
        )
    taken = [row for row in rows if not row[3]]
    try:
        step = np.array([int(row[0]) for row in taken], dtype=np.int64)
        times = np.array([float(row[6]) for row in taken])
        iterations = sum(int(row[4]) for row in rows)
    except (ValueError, OverflowError) as error:
        raise ResultFileError(
            f"{path.name}: {error}, expected the increments of CalculiX"
        ) from None
    if np.any((step < 1) | (step > len(ends))):
        raise ResultFileError(
            f"{path.name}: found *STEP {step.min()} to {step.max()}, expected 1 to {len(ends)}"
        )
    if not len(step) or step[-1] != len(ends):
        raise ResultFileError(
            f"{path.name}: found *STEP {step[-1] if len(step) else 0} as the last one, expected "
            f"{len(ends)}"
        )
    begins = np.append(0.0, ends)[step - 1]
    reached = begins + times
    last = np.append(np.diff(step) > 0, True)
    reached[last] = ends[step[last] - 1]
    return Increments(reached, iterations, len(rows) - len(taken))
