"""Results on disk: HDF5 with units and provenance, CSV for people."""

from __future__ import annotations

import csv
import hashlib
import io
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, TypeVar

import h5py
import numpy as np
from numpy.typing import NDArray

from driver.common.atomic_write import write_whole
from driver.common.errors import InputError, why
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
from driver.results.stage_record import read_record
from meshes.guarded import can_be_read
from solver_adapters.response_file import prismid_version as prismid_version

Array = NDArray[np.float64]
Taken = TypeVar("Taken")

# Bytes of a dataset that a file may hold at least, and for each of its own; that are read at once.
_LEAST_BYTES, _PER_BYTE, _AT_ONCE = 1_000_000_000, 20, 100_000_000
_READER = "driver.results.hdf5:read_datasets"
_COMPRESSED = 1000  # numbers, beyond which a dataset is

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


@dataclass(frozen=True, eq=False)
class FrameSeries:
    """Datasets over T frames that are written some frames at a time.

    Attributes:
        n_frames: T.
        units: unit of each dataset by its name.
        blocks: values of each dataset in the frames that follow, shape (m, ...) by name.
    """

    n_frames: int
    units: Mapping[str, str]
    blocks: Iterable[Mapping[str, NDArray[np.generic]]]


class _Remembering(io.FileIO):
    """A file that remembers why it could not be written, and goes on as if it were.

    HDF5 ends the process, without a word, where a file cannot be written.
    """

    failed: OSError | None = None

    def write(self, content: Any) -> int:
        rest = memoryview(content).cast("B")
        size = len(rest)
        try:
            while rest and self.failed is None:
                rest = rest[super().write(rest) or 0 :]
        except OSError as error:
            self.failed = error
        return size

    def readinto(self, target: Any) -> int:
        wanted = memoryview(target).cast("B")
        found = super().readinto(wanted) or 0
        wanted[found:] = bytes(len(wanted) - found)
        return len(wanted)

    def truncate(self, size: int | None = None) -> int:
        return (size or 0) if self.failed else super().truncate(size)


def write_hdf5(
    path: Path,
    arrays: Mapping[str, tuple[NDArray[np.generic] | float, str]],
    texts: Mapping[str, str] | None = None,
    series: FrameSeries | None = None,
) -> None:
    """Write named arrays with their units.

    Args:
        path: file to write.
        arrays: value and unit by dataset name ("group/name" makes groups).
        texts: text attributes of the file.
        series: datasets over frames that do not fit into memory.

    Raises:
        OSError: the file cannot be written.
    """
    with _Remembering(path, "w+") as written:
        _write(written, arrays, texts or {}, series)
        if written.failed is not None:
            raise written.failed


def _write(
    target: _Remembering,
    arrays: Mapping[str, tuple[NDArray[np.generic] | float, str]],
    texts: Mapping[str, str],
    series: FrameSeries | None,
) -> None:
    with h5py.File(target, "w") as file:
        file.attrs["prismid"] = prismid_version()
        file.attrs["written"] = datetime.now(UTC).isoformat(timespec="seconds")
        for name, text in texts.items():
            file.attrs[name] = text
        for name, (value, unit) in arrays.items():
            array = np.asarray(value)
            compression = "gzip" if array.size > _COMPRESSED else None
            dataset = file.create_dataset(name, data=array, compression=compression)
            dataset.attrs["unit"] = unit
        if series is not None:
            _write_series(file, series, target)


def _write_series(file: h5py.File, series: FrameSeries, target: _Remembering) -> None:
    """Write frames as they come; each block is compressed as a whole."""
    first = 0
    for block in series.blocks:
        if target.failed is not None:
            return
        for name, values in block.items():
            if name not in file:
                rest = values.shape[1:]
                # Of noisy numbers the bytes that are alike are gathered: smaller, in half the time.
                file.create_dataset(
                    name, (series.n_frames, *rest), values.dtype, chunks=(len(values), *rest),
                    compression="gzip", compression_opts=1, shuffle=True,
                ).attrs["unit"] = series.units[name]  # fmt: skip
            file[name][first : first + len(values)] = values
        first += len(next(iter(block.values())))


@dataclass(frozen=True, eq=False)
class StoredSeries:
    """A dataset over frames that stays in its file until some are asked for.

    Attributes:
        path: file.
        name: of the dataset.
        shape: of all of it, frames first.
    """

    path: Path
    name: str
    shape: tuple[int, ...]

    def __len__(self) -> int:
        """Return the number of frames."""
        return self.shape[0]

    def __getitem__(self, index: int, /) -> Array:
        """Values of a frame."""
        with h5py.File(self.path, "r") as file:
            return np.asarray(file[self.name][index])

    def __iter__(self) -> Iterator[Array]:
        """Values of one frame after the other; each block is read once."""
        with h5py.File(self.path, "r") as file:
            dataset = file[self.name]
            together = dataset.chunks[0] if dataset.chunks else 1
            for first in range(0, len(self), together):
                yield from np.asarray(dataset[first : first + together])


def read_hdf5(path: Path | str) -> dict[str, Array]:
    """All datasets of a file by name.

    Raises:
        ResultError: the file is absent, truncated or no HDF5 file.
    """
    return _read(Path(path), lambda name, dataset: np.asarray(dataset[()]))


def open_hdf5(path: Path, stored: Collection[str]) -> dict[str, Any]:
    """All datasets of a file by name, some of them read when a frame of theirs is asked for.

    Args:
        path: file.
        stored: names of those that stay in the file, each of them a `StoredSeries`.

    Raises:
        ResultError: as in `read_hdf5`.
    """

    def taken(name: str, dataset: h5py.Dataset) -> Any:
        if name in stored:
            return StoredSeries(path, name, dataset.shape)
        return np.asarray(dataset[()])

    return _read(path, taken)


def _read(path: Path, taken: Callable[[str, h5py.Dataset], Taken]) -> dict[str, Taken]:
    datasets: dict[str, Taken] = {}

    def take(name: str, item: h5py.Dataset | h5py.Group) -> None:
        if isinstance(item, h5py.Dataset):
            datasets[name] = taken(name, item)

    with _readable(path) as file:
        file.visititems(take)
    return datasets


@contextmanager
def _readable(path: Path) -> Iterator[h5py.File]:
    """Open a file that HDF5 can read.

    Raises:
        ResultError: it cannot, or what is read inside cannot.
    """
    try:
        if not (_is_as_written(path) or can_be_read(_READER, path)):
            raise OSError("what no library can read")
        with h5py.File(path, "r") as file:
            yield file
    except (OSError, ValueError, TypeError, RuntimeError, KeyError, MemoryError) as error:
        raise ResultError(
            f"{path}: found no readable HDF5 file ({why(error)}), expected a result of prismid"
            # A file of any other name may be the user's own.
            + (f"; {_remedy(path)}" if path.name in _STAGES else "")
        ) from None


def read_attributes(path: Path) -> dict[str, Any]:
    """All attributes of a file by name.

    Raises:
        ResultError: as in `read_hdf5`.
    """
    with _readable(path) as file:
        return dict(file.attrs)


def read_datasets(name: str) -> None:
    """Read all datasets of a file, some rows at a time, as a process of its own reads them first.

    Args:
        name: path of the file.

    Raises:
        MemoryError: a dataset is larger than any that a file of this size holds.
    """
    most = _LEAST_BYTES + _PER_BYTE * Path(name).stat().st_size

    def read(_: str, item: h5py.Dataset | h5py.Group) -> None:
        if not isinstance(item, h5py.Dataset):
            return
        if item.nbytes > most:
            raise MemoryError
        together = max(_AT_ONCE // max(item.nbytes // max(len(item), 1), 1), 1) if item.shape else 1
        for first in range(0, len(item) if item.shape else 1, together):
            item[first : first + together] if item.shape else item[()]

    with h5py.File(name, "r") as file:
        dict(file.attrs)
        file.visititems(read)


def _is_as_written(path: Path) -> bool:
    """Whether a result has the content that the record of its stage tells."""
    digests = (entry.get("digests", {}) for entry in read_record(path.parent).values())
    told = {digest for names in digests for name, digest in names.items() if name == path.name}
    if not told:
        return False
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest() in told


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
