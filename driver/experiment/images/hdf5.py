"""Frames of a dataset of an HDF5 file."""

from __future__ import annotations

from math import prod
from pathlib import Path

import h5py
import numpy as np

from driver.common.errors import why
from driver.experiment.images.file_frames import FileFrames, Levels, in_blocks, stack_shape
from driver.experiment.images.files import Refused

_BLOCK = 2**26  # bytes of the frames that are read together where chunks span several


def open_hdf5(file: Path, dataset: str) -> FileFrames:
    """Frames of a dataset, of which every one can be read.

    Raises:
        Refused: the file is unreadable or truncated, or holds no dataset of that name.
    """
    try:
        with h5py.File(file, "r") as content:
            node = content.get(dataset) if dataset else None
            if not isinstance(node, h5py.Dataset):
                raise _no_dataset(file, content, dataset)
            shape = stack_shape(node.shape, node.dtype)
            flat, dtype = node.ndim == 2, node.dtype
            together = _together(node, shape)
        frames = in_blocks(shape, dtype, together, lambda a, b: _read(file, dataset, a, b, flat))
        return frames.all_read()
    except (OSError, ValueError, RuntimeError, KeyError) as error:
        raise Refused(why(error), "an HDF5 file that can be read") from None


def _together(node: h5py.Dataset, shape: tuple[int, int, int]) -> int:
    """Return the frames of a chunk, which are unpacked together, or less where they are large."""
    if node.ndim == 2 or node.chunks is None:
        return 1
    most = _BLOCK // (prod(shape[1:]) * int(node.dtype.itemsize))
    return max(1, min(int(node.chunks[0]), shape[0], most))


def _read(file: Path, dataset: str, first: int, last: int, flat: bool) -> Levels:
    with h5py.File(file, "r") as content:
        node = content[dataset]
        return np.asarray(node[()][np.newaxis] if flat else node[first:last])


def _no_dataset(file: Path, content: h5py.File, dataset: str) -> Refused:
    names: list[str] = []
    content.visititems(
        lambda name, child: names.append(f"/{name}") if isinstance(child, h5py.Dataset) else None
    )
    found = f'no dataset "{dataset}"' if dataset else "no name of a dataset"
    known = ", ".join(names) if names else "a dataset, but the file holds none"
    return Refused(found, f"{file.name}:NAME with NAME one of {known}")
