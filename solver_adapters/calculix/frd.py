"""Displacements from the ASCII results file (.frd): CalculiX GraphiX manual, "Result Format"."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from solver_adapters.calculix.text import read_text
from solver_adapters.interface import FloatArray, IntArray
from solver_adapters.result_files import ResultFileError

_WHAT = "the displacements of CalculiX"
_HEAD, _END = "    1C", " 9999"
_STEP, _DISPLACEMENT, _ROW, _STOP = "    1PSTEP", " -4  DISP", " -1", " -3"
# Columns of a row: node, then three components of twelve characters.
_NODE = slice(3, 13)
_VALUES = (slice(13, 25), slice(25, 37), slice(37, 49))


def read_displacements(path: Path, steps: IntArray, nodes: IntArray) -> FloatArray:
    """Displacement at the ends of *STEPs; the file has six digits of each.

    Args:
        path: the .frd file.
        steps: numbers of the wanted *STEPs, from 1, shape (n_steps,).
        nodes: the wanted nodes, from 0, shape (n_nodes,).

    Returns:
        displacement [µm], shape (n_steps, n_nodes, 3).

    Raises:
        ResultFileError: the file is missing, empty, foreign or truncated, or a step or a node is
            not in it.
    """
    text = read_text(path, _WHAT)
    if not text.startswith(_HEAD):
        raise ResultFileError(
            f"{path.name}: found a file that begins with {text[:20]!r}, expected {_WHAT} in ASCII"
        )
    blocks = dict(_blocks(path, text.splitlines()))
    absent = [int(step) for step in steps if step not in blocks]
    if absent:
        raise ResultFileError(
            f"{path.name}: found {len(steps) - len(absent)} of {len(steps)} instants (the end of "
            f"*STEP {absent[0]} is the first that is not there), expected all"
        )
    result = np.empty((len(steps), len(nodes), 3))
    for row, step in enumerate(steps):
        result[row] = _of_nodes(path, blocks[int(step)], nodes)
    return result


def _blocks(path: Path, lines: list[str]) -> Iterator[tuple[int, list[str]]]:
    """Rows of the displacements of each *STEP, by its number; the last ones of a step count."""
    step, inside, begin = 0, False, 0
    for index, line in enumerate(lines):
        if line.startswith(_STEP):
            step = _integer(path, line.split()[-1])
        elif line.startswith(_DISPLACEMENT):
            inside, begin = True, index + 1
        elif line.startswith(_STOP) and inside:
            yield step, [row for row in lines[begin:index] if row.startswith(_ROW)]
            inside = False
    if lines[-1] != _END:
        raise ResultFileError(
            f"{path.name}: found a truncated file (its last line is {lines[-1][:30]!r}), expected "
            f"{_WHAT} up to the line {_END!r}"
        )


def _of_nodes(path: Path, rows: list[str], nodes: IntArray) -> FloatArray:
    try:
        numbers = np.array([row[_NODE] for row in rows], dtype=np.int64) - 1
        values = np.array([[row[part] for part in _VALUES] for row in rows], dtype=np.float64)
    except ValueError as error:
        raise ResultFileError(
            f"{path.name}: found a row that is no displacement ({error}), expected {_WHAT}"
        ) from None
    order = np.argsort(numbers)
    place = np.clip(np.searchsorted(numbers, nodes, sorter=order), 0, max(len(numbers) - 1, 0))
    missing = nodes if not len(numbers) else nodes[numbers[order[place]] != nodes]
    if missing.size:
        raise ResultFileError(
            f"{path.name}: found no displacement of {missing.size} of {len(nodes)} nodes, the "
            f"first is node {missing[0] + 1}, expected those of this job"
        )
    return np.asarray(values[order[place]])


def _integer(path: Path, word: str) -> int:
    if not word.isdigit():
        raise ResultFileError(
            f"{path.name}: found {word!r} as the number of a *STEP, expected a whole number"
        )
    return int(word)
