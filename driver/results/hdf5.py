"""Results on disk: HDF5 with units and provenance, CSV for people."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from driver.common.atomic_write import write_whole
from driver.common.errors import InputError
from driver.results.files import (
    ADVICE,
    DIAGNOSIS,
    DIAGNOSIS_H5,
    FINE_MESH,
    HISTORY_JSON,
    IDENTIFY,
    MEASURE,
    MESH,
)
from solver_adapters.response_file import prismid_version as prismid_version

Array = NDArray[np.float64]

# Of results that a later stage reads back, the stage that makes them.
_STAGES = {
    MESH: "mesh",
    FINE_MESH: "mesh",
    MEASURE: "measure",
    IDENTIFY: "identify",
    HISTORY_JSON: "identify",
    DIAGNOSIS: "diagnose",
    DIAGNOSIS_H5: "diagnose",
    ADVICE: "advise",
}


class ResultError(InputError):
    """A result file that cannot be read back."""


def write_hdf5(
    path: Path,
    arrays: Mapping[str, tuple[NDArray[np.generic] | float, str]],
    texts: Mapping[str, str] | None = None,
) -> None:
    """Write named arrays with their units.

    Args:
        path: file to write.
        arrays: value and unit by dataset name ("group/name" makes groups).
        texts: text attributes of the file.
    """
    # Written at once: of a disk that is full HDF5 makes an end without a word.
    whole = io.BytesIO()
    with h5py.File(whole, "w") as file:
        file.attrs["prismid"] = prismid_version()
        file.attrs["written"] = datetime.now(UTC).isoformat(timespec="seconds")
        for name, text in (texts or {}).items():
            file.attrs[name] = text
        for name, (value, unit) in arrays.items():
            array = np.asarray(value)
            compression = "gzip" if array.size > 1000 else None
            dataset = file.create_dataset(name, data=array, compression=compression)
            dataset.attrs["unit"] = unit
    path.write_bytes(whole.getbuffer())


def read_hdf5(path: Path) -> dict[str, Array]:
    """All datasets of a file by name.

    Raises:
        ResultError: the file is absent, truncated or no HDF5 file.
    """
    datasets: dict[str, Array] = {}

    def take(name: str, item: h5py.Dataset | h5py.Group) -> None:
        if isinstance(item, h5py.Dataset):
            datasets[name] = np.asarray(item[()])

    try:
        with h5py.File(path, "r") as file:
            file.visititems(take)
    except OSError as error:
        raise ResultError(
            f"{path}: found no readable HDF5 file ({error}), expected a result of prismid; "
            f"{_remedy(path)}"
        ) from None
    return datasets


def damaged(path: Path, found: str) -> ResultError:
    """Return the sentence about a result that is not what its stage writes."""
    return ResultError(
        f"{path}: found {found}, expected a result of this version of prismid; {_remedy(path)}"
    )


def _remedy(path: Path) -> str:
    stage = _STAGES.get(path.name)
    alone = "" if stage is None else f", running the stage {stage} alone"
    return f"delete it, and `prismid run` makes it anew{alone}"


def write_csv(path: Path, columns: Mapping[str, Sequence[object] | Array]) -> None:
    """Write columns of equal length, whole or not at all; floats with six significant digits."""
    file = io.StringIO(newline="")
    writer = csv.writer(file)
    writer.writerow(columns)
    for row in zip(*columns.values(), strict=True):
        writer.writerow([f"{x:.6g}" if isinstance(x, float) else x for x in row])
    write_whole(path, file.getvalue())
