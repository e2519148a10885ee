"""Displacements and sums of reactions from the printed results (.dat)."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from meshes.arrays import FloatArray, IntArray
from solver_adapters.calculix.text import read_text
from solver_adapters.result_files import ResultFileError

_TOTAL = re.compile(
    r"total force \(fx,fy,fz\) for set (\S+) and time +(\S+)\s*\n\s*\n +(\S+) +(\S+) +(\S+)[ ]*\n"
)
_MOTION = re.compile(
    r"displacements \(vx,vy,vz\) for set (\S+) and time +(\S+)\s*\n\s*\n((?: +\d+ .*\n)*)"
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
    found = [match.groups() for match in _TOTAL.finditer(read_text(path, what))]
    _refuse_others(path, {row[0] for row in found}, name, what, "sum of reactions")
    table = _numbers(path, [" ".join(row[1:]) for row in found], 4, what)
    _refuse_other_instants(path, table[:, 0], instants, "sum of reactions")
    return table[: len(instants), 1:]


def read_displacements(path: Path, name: str, instants: FloatArray, nodes: IntArray) -> FloatArray:
    """Displacement of the nodes of a set; the file has seven digits of each.

    Args:
        path: the .dat file.
        name: the node set.
        instants: the wanted instants since the start of the run [s], shape (n_instants,).
        nodes: the wanted nodes, from 0, shape (n_nodes,).

    Returns:
        displacement [µm], shape (n_instants, n_nodes, 3).

    Raises:
        ResultFileError: the file is missing, empty, foreign or truncated, or an instant or a node
            is not in it.
    """
    what = f"the displacements of {name}"
    found = [match.groups() for match in _MOTION.finditer(read_text(path, what))]
    _refuse_others(path, {row[0] for row in found}, name, what, "displacements")
    times = _numbers(path, [row[1] for row in found], 1, what)[:, 0]
    _refuse_other_instants(path, times, instants, "displacements")
    result = np.empty((len(instants), len(nodes), 3))
    for row, (_, _, rows) in enumerate(found[: len(instants)]):
        result[row] = _of_nodes(path, _numbers(path, rows.splitlines(), 4, what), nodes)
    return result


def _refuse_others(path: Path, sets: set[str], name: str, what: str, kind: str) -> None:
    if not sets:
        raise ResultFileError(f"{path.name}: found no {kind}, expected {what}")
    if others := sets - {name}:
        raise ResultFileError(f"{path.name}: found the set {min(others)}, expected {what}")


def _refuse_other_instants(path: Path, times: FloatArray, instants: FloatArray, kind: str) -> None:
    for row, instant in enumerate(instants):
        if row >= len(times) or abs(times[row] - instant) > _TIME * max(instant, times[row]):
            raise ResultFileError(
                f"{path.name}: found no {kind} at {instant:g} s (it has {len(times)} "
                f"instants up to {times[-1]:g} s), expected {len(instants)}"
            )


def _numbers(path: Path, rows: list[str], width: int, what: str) -> FloatArray:
    """Return rows of so many numbers, shape (n_rows, width)."""
    try:
        return np.array([row.split() for row in rows], dtype=np.float64).reshape(-1, width)
    except ValueError as error:
        raise ResultFileError(f"{path.name}: {error}, expected {what}") from None


def _of_nodes(path: Path, table: FloatArray, nodes: IntArray) -> FloatArray:
    numbers = table[:, 0] - 1  # as they are: a damaged one need not fit a whole number
    order = np.argsort(numbers)
    place = np.clip(np.searchsorted(numbers, nodes, sorter=order), 0, max(len(numbers) - 1, 0))
    missing = nodes if not len(numbers) else nodes[numbers[order[place]] != nodes]
    if missing.size:
        raise ResultFileError(
            f"{path.name}: found no displacement of {missing.size} of {len(nodes)} nodes, the "
            f"first is node {missing[0] + 1}, expected those of this job"
        )
    return np.asarray(table[order[place], 1:])
