"""Writing down how far a run has come, and going on from there."""

from __future__ import annotations

import os
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from solver_adapters.bundled.instants import Increment, Instant

FloatArray = NDArray[np.float64]

FILE = "restart.npz"


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """A run up to an instant.

    Attributes:
        index: the last instant reached, an index into the times of the simulation.
        instant: the state there.
        last: increments from which later steps start, by whether the boundary moved.
        rows: results so far, by name.
        ends: ends of the time steps taken [s].
        counts: steps, iterations, cuts, refinements.
    """

    index: int
    instant: Instant
    last: dict[bool, Increment]
    rows: dict[str, FloatArray]
    ends: list[float]
    counts: tuple[int, int, int, int]


def write(workspace: Path, key: str, checkpoint: Checkpoint) -> None:
    """Replace the checkpoint of a workspace; an interrupted write leaves the old one."""
    arrays: dict[str, Any] = {
        "key": np.array(key),
        "index": np.array(checkpoint.index),
        "ends": np.array(checkpoint.ends),
        "counts": np.array(checkpoint.counts),
    }
    arrays |= {f"row_{name}": value for name, value in checkpoint.rows.items()}
    arrays |= {f"instant_{f.name}": getattr(checkpoint.instant, f.name) for f in fields(Instant)}
    for moved, increment in checkpoint.last.items():
        prefix = "moved" if moved else "held"
        arrays |= {f"{prefix}_{f.name}": getattr(increment, f.name) for f in fields(Increment)}
    workspace.mkdir(parents=True, exist_ok=True)
    aside = workspace / f"{FILE}.part"
    with aside.open("wb") as stream:
        np.savez(stream, **arrays)
    os.replace(aside, workspace / FILE)


def read(workspace: Path, key: str) -> Checkpoint | None:
    """The checkpoint of a workspace, None where there is none of this simulation and solver."""
    try:
        with (workspace / FILE).open("rb") as stream, np.load(stream) as stored:
            if str(stored["key"]) != key:
                return None
            names = set(stored.files)
            instant = Instant(
                **{f.name: _plain(stored[f"instant_{f.name}"]) for f in fields(Instant)}
            )
            last = {
                moved: Increment(
                    **{f.name: _plain(stored[f"{prefix}_{f.name}"]) for f in fields(Increment)}
                )
                for moved, prefix in ((True, "moved"), (False, "held"))
                if f"{prefix}_dt" in names
            }
            rows = {name[4:]: stored[name] for name in names if name.startswith("row_")}
            counts = tuple(int(count) for count in stored["counts"])
            return Checkpoint(
                int(stored["index"]),
                instant,
                last,
                rows,
                [float(end) for end in stored["ends"]],
                (counts[0], counts[1], counts[2], counts[3]),
            )
    except (OSError, EOFError, BadZipFile, ValueError, KeyError):
        # No file, a damaged one or that of another version: the run starts anew.
        return None


def _plain(value: FloatArray) -> Any:
    return float(value) if value.ndim == 0 else value
