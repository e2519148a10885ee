"""Writing down how far a run has come, and going on from there."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from meshes.arrays import FloatArray
from solver_adapters.bundled.fem.state import Increment, Instant
from solver_adapters.interface import SolverError

FILE = "restart.npz"
_ROUNDING = 1e-9  # of the time of an instant (share of all)


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """A run up to an instant.

    Attributes:
        index: the last instant reached, an index into the times of the simulation.
        instant: the state there.
        last: increments from which later steps start, by whether the boundary moved.
        rows: results so far, by name.
        ends: ends of the time steps taken [s].
        course: the displacement there [µm], (n_nodes, 3).
        counts: steps, iterations, cuts, refinements.
    """

    index: int
    instant: Instant
    last: dict[bool, Increment]
    rows: dict[str, FloatArray]
    ends: list[float]
    course: list[FloatArray]
    counts: tuple[int, int, int, int]


def write(workspace: Path, key: str, checkpoint: Checkpoint) -> None:
    """Replace the checkpoint of a workspace; an interrupted write leaves the old one."""
    arrays: dict[str, Any] = {
        "key": np.array(key),
        "index": np.array(checkpoint.index),
        "ends": np.array(checkpoint.ends),
        "course": np.array(checkpoint.course),
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
    """Return the checkpoint of a workspace, None where there is none of this simulation and solver.

    Raises:
        SolverError: a folder stands where the file of a checkpoint will be written.
    """
    if (workspace / FILE).is_dir():
        raise SolverError(f"{workspace / FILE}: found a folder; expected a checkpoint or nothing")
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
            steps, iterations, cuts, refinements = (int(count) for count in stored["counts"])
            return Checkpoint(
                int(stored["index"]),
                instant,
                last,
                rows,
                [float(end) for end in stored["ends"]],
                list(stored["course"]),
                (steps, iterations, cuts, refinements),
            )
    except (OSError, EOFError, BadZipFile, ValueError, KeyError, TypeError):
        # No file, a damaged one or that of another version: the run starts anew.
        return None


def fits(
    checkpoint: Checkpoint,
    start: Instant,
    rows: Mapping[str, FloatArray],
    times: FloatArray,
    n_prescribed: int,
) -> bool:
    """Whether a run could have written a checkpoint: an instant of it, with arrays of its shapes.

    Args:
        checkpoint: what was read.
        start: the state of the run at its first instant.
        rows: results of the run by name, yet to be filled.
        times: its instants [s], shape (n_times,).
        n_prescribed: number of its prescribed degrees of freedom.
    """
    instant = checkpoint.instant
    if _shapes(vars(instant)) != _shapes(vars(start)) or not 0 <= checkpoint.index < len(times):
        return False
    away = abs(instant.time - times[checkpoint.index])
    slips = len(start.H), start.slip.shape[1]
    increment = {
        "du": start.u.shape, "slips": slips, "motion": (n_prescribed,), "dt": (),
        "near": start.u.shape,
    }  # fmt: skip
    return (
        bool(away <= _ROUNDING * (times[-1] - times[0]))
        and all(_shapes(vars(last)) == increment for last in checkpoint.last.values())
        and _shapes(checkpoint.rows) == _shapes(rows)
        and len(checkpoint.ends) == len(checkpoint.course) == checkpoint.counts[0]
        and all(np.shape(u) == start.u.shape for u in checkpoint.course)
    )


def _shapes(arrays: Mapping[str, Any]) -> dict[str, tuple[int, ...] | None]:
    """Shapes by name, None of what are no finite numbers."""
    return {
        name: np.shape(array)
        if np.asarray(array).dtype.kind == "f" and np.isfinite(array).all()
        else None
        for name, array in arrays.items()
    }


def _plain(value: FloatArray) -> Any:
    return float(value) if value.ndim == 0 else value
