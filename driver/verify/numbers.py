"""What a result file holds as named arrays of numbers and texts, whatever its format."""

from __future__ import annotations

import csv
import json
import re
import tomllib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray

from driver.common.errors import InputError, why
from driver.results.hdf5 import damaged, read_attributes, read_hdf5
from meshes.files import read_med

Values = Mapping[str, NDArray[np.generic]]

# When and for how long a result was computed, and by which version.
_NO_RESULT = ("prismid", "written", "seconds")
NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][-+]?\d+)?")
"""A number in a text."""
_FAULTS = (OSError, ValueError, KeyError, TypeError, IndexError, RecursionError)


@dataclass(frozen=True)
class Format:
    """A format of results.

    Attributes:
        read: returns the arrays of a file by name.
        rounding: what its numbers are rounded to when they are written, of their size.
    """

    read: Callable[[Path], Values]
    rounding: float = 0.0


def numbers_of(path: Path) -> Values:
    """Return what a file holds: arrays of numbers, or of texts, by name.

    Raises:
        InputError: it cannot be read.
    """
    try:
        return FORMATS[path.suffix].read(path)
    except InputError:
        raise
    except _FAULTS as error:
        raise damaged(path, f"what cannot be read ({why(error)})") from None


def _hdf5(path: Path) -> Values:
    values: dict[str, NDArray[np.generic]] = dict(read_hdf5(path))
    for name, value in read_attributes(path).items():
        if name not in _NO_RESULT:
            values[f"attribute {name}"] = np.asarray(value)
    return values


def _json(path: Path) -> Values:
    return dict(_leaves(json.loads(path.read_text(encoding="utf-8")), ""))


def _toml(path: Path) -> Values:
    # Its texts name files, which another folder names otherwise.
    leaves = _leaves(tomllib.loads(path.read_text(encoding="utf-8")), "")
    return {name: value for name, value in leaves if value.dtype.kind not in "U"}


def _leaves(node: Any, name: str) -> Iterator[tuple[str, NDArray[np.generic]]]:
    """Yield lists of numbers and single values of nested tables, by their dotted keys."""
    if isinstance(node, Mapping):
        for key, value in node.items():
            if key not in _NO_RESULT:
                yield from _leaves(value, f"{name}.{key}" if name else str(key))
    elif isinstance(node, list):
        if node and all(type(entry) in (int, float) for entry in node):
            yield name, np.asarray(node)
        else:
            for index, entry in enumerate(node):
                yield from _leaves(entry, f"{name}[{index}]")
    else:
        yield name, np.asarray("null" if node is None else node)


def _csv(path: Path) -> Values:
    with path.open(encoding="utf-8", newline="") as file:
        # Tables of decks begin with words on them.
        header, *rows = (row for row in csv.reader(file) if not row[0].startswith("#"))
    columns = zip(header, zip(*rows, strict=True), strict=True) if rows else ()
    return {name: _column(column) for name, column in columns}


def _column(texts: tuple[str, ...]) -> NDArray[np.generic]:
    try:
        return np.array([float(text) for text in texts])
    except ValueError:
        return np.array(texts)


def _med(path: Path) -> Values:
    mesh = read_med(path)
    return {
        "points": mesh.points,
        "cells": mesh.cells,
        "grain": mesh.grain,
        **{f"faces of {name}": faces for name, faces in mesh.faces.items()},
        **{f"nodes of {name}": nodes for name, nodes in mesh.nodes.items()},
    }


def _tiff(path: Path) -> Values:
    return {"image": tifffile.imread(path)}


def _deck(path: Path) -> Values:
    text = path.read_text(encoding="utf-8")
    return {"numbers": np.array([float(_fortran(n)) for n in NUMBER.findall(text)])}


def _fortran(number: str) -> str:
    return number.replace("d", "e").replace("D", "e")


FORMATS: Mapping[str, Format] = {
    ".h5": Format(_hdf5),
    ".json": Format(_json),
    ".csv": Format(_csv, 1e-5),
    ".med": Format(_med),
    ".tif": Format(_tiff),
    ".toml": Format(_toml),
    ".inp": Format(_deck),
    ".comm": Format(_deck),
}
"""The formats that are compared, by the ending of their files."""
