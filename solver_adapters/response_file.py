"""A response on disk: HDF5 with units, descriptions and provenance."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, fields
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from meshes.guarded import can_be_read
from solver_adapters.crystal import SYSTEM_COUNTS
from solver_adapters.interface import CellFields, Response, Trajectory
from solver_adapters.result_files import ResultFileError

_FORMAT, _REVISION = "prismid response", 2
_READER = "solver_adapters.response_file:try_response"

# Unit and description of each dataset; directions are differentiated in units of their own.
_DATASETS = {
    "displacement": ("µm", "displacement (output instant, output node, X Y Z)"),
    "force": ("µN", "force along Y on the face S_PLUS (output instant)"),
    "d_displacement": (
        "µm per unit of the direction",
        "derivative of the displacement (direction, output instant, output node, X Y Z)",
    ),
    "d_force": ("µN per unit of the direction", "derivative of the force (direction, instant)"),
    "steps": ("1", "time steps taken"),
    "iterations": ("1", "Newton iterations in all"),
    "cuts": ("1", "steps that had to be cut to converge"),
    "refinements": ("1", "steps that had to be cut for accuracy"),
    "ends": ("s", "ends of the time steps taken"),
}
_CELLS = {
    "stress": ("MPa", "mean Cauchy stress (output instant, cell, XX YY ZZ YZ XZ XY)"),
    "slip": ("1", "signed slip since the start (output instant, cell, slip system)"),
    "accumulated_slip": ("1", "slip without signs (output instant, cell, slip system)"),
    "rotation": ("rad", "rotation vector of the lattice (output instant, cell, X Y Z)"),
}
_TRAJECTORY = {
    "times": ("s", "the first instant and the ends of the time steps"),
    "displacement": ("µm", "displacement of all nodes there (instant, node, X Y Z)"),
}
_COUNTS = ("steps", "iterations", "cuts", "refinements")


@dataclass(frozen=True)
class Provenance:
    """Where a response comes from.

    Attributes:
        adapter: name of the solver adapter.
        solver: identity of the solver.
        key: the key of the job.
        prismid: version of prismid that wrote it, "" for the one that runs.
        written: when [ISO 8601, UTC], "" for the moment of writing.
    """

    adapter: str
    solver: str
    key: str
    prismid: str = ""
    written: str = ""


def write_response(path: Path, response: Response, provenance: Provenance) -> None:
    """Write a response; an interrupted write leaves the old file."""
    aside = path.with_name(path.name + ".partial")
    # The format of HDF5 1.10 has checksums of its own tables, unlike the earliest one.
    with h5py.File(aside, "w", libver="v110") as file:
        file.attrs["format"], file.attrs["revision"] = _FORMAT, _REVISION
        file.attrs["adapter"] = provenance.adapter
        file.attrs["solver"] = provenance.solver
        file.attrs["key"] = provenance.key
        file.attrs["prismid"] = provenance.prismid or prismid_version()
        now = datetime.now(UTC).isoformat(timespec="seconds")
        file.attrs["written"] = provenance.written or now
        for name, (unit, description) in _DATASETS.items():
            _put(file, name, getattr(response, name), unit, description)
        notes = np.array(response.notes, dtype=h5py.string_dtype())
        _put(file, "notes", notes, "1", "what a reader of the numbers should know, sentences")
        seconds = file.create_group("seconds")
        for name, value in response.seconds.items():
            _put(seconds, name, value, "s", f"wall-clock time of {name}")
        if response.cells is not None:
            cells = file.create_group("cells")
            for name, (unit, description) in _CELLS.items():
                _put(cells, name, getattr(response.cells, name), unit, description)
        if response.trajectory is not None:
            trajectory = file.create_group("trajectory")
            for name, (unit, description) in _TRAJECTORY.items():
                _put(trajectory, name, getattr(response.trajectory, name), unit, description)
    os.replace(aside, path)


def read_response(path: Path, as_written: bool = False) -> Response:
    """Return the response of a file.

    Args:
        path: the file.
        as_written: whether its checksum is that of what prismid has written; any other file is
            tried by a process of its own first.

    Raises:
        ResultFileError: the file is absent, empty, truncated, foreign, incomplete or damaged.
    """
    with _opened(path, as_written) as file, _told(path):
        values: dict[str, Any] = {name: _take(path, file, name) for name in _DATASETS}
        values |= {name: int(values[name]) for name in _COUNTS}
        values["seconds"] = {
            name: float(data[()]) for name, data in file.get("seconds", {}).items()
        }
        values["notes"] = tuple(note.decode() for note in _take(path, file, "notes"))
        if "cells" in file:
            taken = {name: _take(path, file, f"cells/{name}") for name in _CELLS}
            values["cells"] = CellFields(**taken)
        if "trajectory" in file:
            values["trajectory"] = Trajectory(
                **{name: _take(path, file, f"trajectory/{name}") for name in _TRAJECTORY}
            )
    response = Response(**values)
    _refuse_unfit(path, response)
    return response


def read_provenance(path: Path, as_written: bool = False) -> Provenance:
    """Where the response of a file comes from.

    Args:
        path: the file.
        as_written: as of `read_response`.

    Raises:
        ResultFileError: as `read_response`.
    """
    with _opened(path, as_written) as file, _told(path):
        attributes: Mapping[str, Any] = file.attrs
        return Provenance(**{item.name: str(attributes[item.name]) for item in fields(Provenance)})


def try_response(path: str) -> None:
    """Read all of a file, in the process that tries files first."""
    read_provenance(Path(path))
    read_response(Path(path))


@contextmanager
def _told(path: Path) -> Iterator[None]:
    """Tell in one sentence what h5py makes of a damaged byte, which may be any error."""
    try:
        yield
    except ResultFileError:
        raise
    except Exception as error:
        raise ResultFileError(
            f"{path}: found damaged HDF5 ({type(error).__name__}), expected a response that "
            "prismid has written"
        ) from None


def _refuse_unfit(path: Path, response: Response) -> None:
    """Raise where the arrays do not fit each other, or a number is not finite."""
    instants, directions = response.force.size, len(response.d_force)
    nodes = response.displacement.shape[1] if response.displacement.ndim == 3 else 0
    shapes = {
        "displacement": (instants, nodes, 3),
        "force": (instants,),
        "d_displacement": (directions, instants, nodes, 3),
        "d_force": (directions, instants),
        "ends": (response.ends.size,),
    }
    arrays = {name: getattr(response, name) for name in shapes}
    if response.cells is not None:
        cells = response.cells.stress.shape[1] if response.cells.stress.ndim == 3 else 0
        systems = response.cells.slip.shape[-1] if response.cells.slip.ndim == 3 else 0
        if systems not in SYSTEM_COUNTS:
            systems = SYSTEM_COUNTS[0]
        widths = {"stress": 6, "slip": systems, "accumulated_slip": systems, "rotation": 3}
        for name, width in widths.items():
            shapes[f"cells/{name}"] = (instants, cells, width)
            arrays[f"cells/{name}"] = getattr(response.cells, name)
    if response.trajectory is not None:
        trajectory = response.trajectory
        everywhere = trajectory.displacement.shape[1] if trajectory.displacement.ndim == 3 else 0
        shapes |= {
            "trajectory/times": (trajectory.times.size,),
            "trajectory/displacement": (trajectory.times.size, everywhere, 3),
        }  # fmt: skip
        arrays |= {
            "trajectory/times": trajectory.times,
            "trajectory/displacement": trajectory.displacement,
        }
    for name, array in arrays.items():
        if array.shape != shapes[name]:
            raise ResultFileError(
                f"{path}: found {name} of shape {array.shape}, expected {shapes[name]}"
            )
        if array.dtype != np.float64 or not np.isfinite(array).all():
            raise ResultFileError(
                f"{path}: found values of {name} that are no finite numbers, expected such"
            )


def prismid_version() -> str:
    """Version of the installed distribution."""
    try:
        return version("prismid")
    except PackageNotFoundError:
        return "unknown (not installed)"


def _put(group: h5py.Group, name: str, value: Any, unit: str, description: str) -> None:
    array = np.asarray(value)
    # A checksum for each array of numbers; HDF5 has none for a scalar or for texts.
    checked = bool(array.ndim and array.size) and array.dtype.kind in "fi"
    dataset = group.create_dataset(
        name, data=array, compression="gzip" if array.size > 1000 else None, fletcher32=checked
    )
    dataset.attrs["unit"], dataset.attrs["description"] = unit, description


def _opened(path: Path, as_written: bool) -> h5py.File:
    expected = "expected a response that prismid has written"
    if not path.is_file():
        raise ResultFileError(f"{path}: found nothing, {expected}")
    if not path.stat().st_size:
        raise ResultFileError(f"{path}: found an empty file, {expected}")
    if not (as_written or can_be_read(_READER, path)):
        raise ResultFileError(f"{path}: found HDF5 that cannot be read, {expected}")
    try:
        file = h5py.File(path, "r")
    except OSError as error:
        cut = "truncated" in str(error)
        found = "a truncated HDF5 file" if cut else "no HDF5 file"
        raise ResultFileError(f"{path}: found {found}, {expected}") from None
    try:
        with _told(path):
            origin = file.attrs.get("format"), file.attrs.get("revision")
            if origin != (_FORMAT, _REVISION):
                raise ResultFileError(
                    f"{path}: found HDF5 of another origin, {expected} (revision {_REVISION})"
                )
    except ResultFileError:
        file.close()
        raise
    return file


def _take(path: Path, file: h5py.File, name: str) -> Any:
    try:
        return np.asarray(file[name][()])
    except (KeyError, OSError):
        raise ResultFileError(
            f"{path}: found no readable dataset {name}, expected a whole response"
        ) from None
