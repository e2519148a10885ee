"""Frames of a dataset of an HDF5 file."""

from __future__ import annotations

from contextlib import suppress
from functools import partial
from importlib import import_module
from math import prod
from pathlib import Path

import h5py
import numpy as np

from driver.common.errors import why
from driver.experiment.images.file_frames import FileFrames, Levels, in_blocks, stack_shape
from driver.experiment.images.files import MATLAB, Refused

_MATLAB = "MATLAB_class"  # attribute of every array that MATLAB saves
_BLOCK = 2**26  # bytes of the frames that are read together where chunks span several


def open_hdf5(file: Path, dataset: str) -> FileFrames:
    """Frames of a dataset, of which every one can be read.

    An array that MATLAB has saved has the rows and columns that MATLAB shows.

    Raises:
        Refused: the file is unreadable or truncated, or holds no dataset of that name.
    """
    absent: list[str] = []
    try:
        with h5py.File(file, "r") as content:
            node = content.get(dataset) if dataset else None
            if not isinstance(node, h5py.Dataset):
                raise _no_dataset(file, content, dataset)
            shape = stack_shape(node.shape, node.dtype)
            if _MATLAB in node.attrs:
                shape = (shape[0], shape[2], shape[1])
            dtype, together = node.dtype, _together(node, shape)
            absent = _absent_filters(node)
        frames = in_blocks(shape, dtype, together, partial(_read, file, dataset))
        return frames.all_read()
    except (OSError, ValueError, RuntimeError, KeyError, TypeError, MemoryError) as error:
        if absent:
            found = f"levels compressed by {', '.join(absent)}, which this HDF5 library lacks"
            expected = "`pip install hdf5plugin`, or a file written anew with gzip (h5repack)"
            raise Refused(found, expected) from None
        expected = "an HDF5 file that can be read"
        if file.suffix.lower() == MATLAB and not h5py.is_hdf5(file):
            expected = "a MATLAB file of version 7.3, which is HDF5: save(…, '-v7.3')"
        raise Refused(why(error), expected) from None


def _absent_filters(node: h5py.Dataset) -> list[str]:
    """Return the filters of a dataset that are not there, nor among the plugins."""
    created = node.id.get_create_plist()
    filters = [created.get_filter(number) for number in range(created.get_nfilters())]

    def absent() -> list[str]:
        return [
            f"filter {number} ({name.decode(errors='replace')})"
            for number, _, _, name in filters
            if not h5py.h5z.filter_avail(number)
        ]

    if absent():
        with suppress(ImportError):
            import_module("hdf5plugin")  # it tells HDF5 where they are
    return absent()


def _together(node: h5py.Dataset, shape: tuple[int, int, int]) -> int:
    """Return the frames of a chunk, which are unpacked together, or less where they are large."""
    if node.ndim == 2 or node.chunks is None:
        return 1
    most = _BLOCK // (prod(shape[1:]) * int(node.dtype.itemsize))
    return max(1, min(int(node.chunks[0]), shape[0], most))


def _read(file: Path, dataset: str, first: int, last: int) -> Levels:
    with h5py.File(file, "r") as content:
        node = content[dataset]
        levels = np.asarray(node[()][np.newaxis] if node.ndim == 2 else node[first:last])
        # MATLAB counts axes from the other end: its (rows, columns, frames) is stored turned.
        return levels.swapaxes(1, 2) if _MATLAB in node.attrs else levels


def _no_dataset(file: Path, content: h5py.File, dataset: str) -> Refused:
    names: list[str] = []
    content.visititems(
        lambda name, child: names.append(f"/{name}") if isinstance(child, h5py.Dataset) else None
    )
    found = f'no dataset "{dataset}"' if dataset else "no name of a dataset"
    known = ", ".join(names) if names else "a dataset, but the file holds none"
    return Refused(found, f"{file.name}:NAME with NAME one of {known}")
