"""How large the images of a case are, from the headers of their files."""

from __future__ import annotations

from dataclasses import dataclass

import h5py
import numpy as np
import tifffile

from driver.case.model import Case
from driver.experiment.images.files import HDF5, Refused, files_of, split_dataset


@dataclass(frozen=True)
class StackSize:
    """Size of a stack.

    Attributes:
        n: number of frames.
        pixels: of a frame.
        stored: bytes of a pixel in the file.
    """

    n: int
    pixels: int
    stored: int


def stack_size(case: Case, key: str) -> StackSize | None:
    """Size of the frames, flats or repeats of a case, all files as large as the first.

    Returns:
        None where the case names none, or no header can be read: reading them tells why.
    """
    name: str | None = getattr(case.images, key)
    if name is None:
        return None
    path, dataset = split_dataset(case.path(name))
    try:
        files = files_of(path)
        shape, kind = _header(str(files[0]), dataset)
        n, rows, columns = shape if len(shape) == 3 else (1, *shape)
    except (Refused, OSError, ValueError, LookupError, TypeError, tifffile.TiffFileError):
        return None
    return StackSize(len(files) * n, rows * columns, kind.itemsize)


def _header(file: str, dataset: str) -> tuple[tuple[int, ...], np.dtype[np.generic]]:
    """Shape and type of what a file holds."""
    suffix = "." + file.rsplit(".", 1)[-1].lower()
    if suffix in HDF5:
        with h5py.File(file, "r") as content:
            return content[dataset].shape, content[dataset].dtype
    if suffix == ".npy":
        levels = np.load(file, mmap_mode="r", allow_pickle=False)
        return levels.shape, levels.dtype
    if suffix == ".png":
        with open(file, "rb") as picture:
            start = picture.read(25)
        size = int.from_bytes(start[20:24]), int.from_bytes(start[16:20])
        return size, np.dtype(np.uint16 if start[24] == 16 else np.uint8)
    with tifffile.TiffFile(file) as tiff:
        first = tiff.pages.first
        return (len(tiff.pages), *first.shape), np.dtype(first.dtype)
