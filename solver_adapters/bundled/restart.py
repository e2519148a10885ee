"""Writing down how far a run has come, and going on from there."""

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from solver_adapters.bundled.instants import Increment, Instant
from solver_adapters.interface import Simulation

FloatArray = NDArray[np.float64]

FILE = "restart.npz"


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """A run up to an instant.

    Attributes:
        index: the last instant reached, an index into the times of the simulation.
        frame: the state there.
        last: increments from which later steps start, by whether the boundary moved.
        rows: results so far, by name.
        ends: ends of the time steps taken [s].
        counts: steps, iterations, cuts, refinements.
    """

    index: int
    frame: Instant
    last: dict[bool, Increment]
    rows: dict[str, FloatArray]
    ends: list[float]
    counts: tuple[int, int, int, int]


def simulation_key(simulation: Simulation, version: str) -> str:
    """Hash of a simulation and of the solver that runs it."""
    digest = hashlib.sha256(version.encode())
    _feed(digest, simulation)
    return digest.hexdigest()


def _feed(digest: Any, value: Any) -> None:
    if is_dataclass(value):
        for item in fields(value):
            digest.update(item.name.encode())
            _feed(digest, getattr(value, item.name))
    elif isinstance(value, np.ndarray):
        digest.update(f"{value.dtype.str}{value.shape}".encode())
        digest.update(np.ascontiguousarray(value).tobytes())
    elif isinstance(value, dict):
        for key in sorted(value):
            digest.update(str(key).encode())
            _feed(digest, value[key])
    elif isinstance(value, tuple):
        digest.update(str(len(value)).encode())
        for part in value:
            _feed(digest, part)
    else:
        digest.update(repr(value).encode())


def write(workspace: Path, key: str, checkpoint: Checkpoint) -> None:
    """Replace the checkpoint of a workspace; an interrupted write leaves the old one."""
    arrays: dict[str, Any] = {
        "key": np.array(key),
        "index": np.array(checkpoint.index),
        "ends": np.array(checkpoint.ends),
        "counts": np.array(checkpoint.counts),
    }
    arrays |= {f"row_{name}": value for name, value in checkpoint.rows.items()}
    arrays |= {f"frame_{f.name}": getattr(checkpoint.frame, f.name) for f in fields(Instant)}
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
            frame = Instant(**{f.name: _plain(stored[f"frame_{f.name}"]) for f in fields(Instant)})
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
                frame,
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
