"""How large the images of a file are, from its header, before a byte of them is decoded."""

from __future__ import annotations

import struct
from math import prod
from pathlib import Path
from typing import Any, BinaryIO

import h5py
import numpy as np
import tifffile

from driver.case.instrument_files import INSTRUMENTS
from driver.experiment.images.files import HDF5, Refused
from driver.experiment.images.instruments import instrument_size
from meshes.guarded import can_be_read

MOST_PIXELS = 100_000_000
"""Pixels of a frame beyond which it is no height map of a micro-specimen."""
MOST_BYTES = 8_000_000_000
"""Bytes of all levels of a file."""

Header = tuple[tuple[int, ...], np.dtype[np.generic]]


def header(file: Path, dataset: str = "") -> Header:
    """Shape and type of what a file says that it holds.

    Args:
        file: a .tif, .tiff, .png, .npy, .h5, .hdf5, .hdf or .mat file, or one of an instrument.
        dataset: name of the dataset in an HDF5 file.

    Raises:
        Refused: the directory of a TIFF file points back at itself, an HDF5 file ends the process
            that reads it, or the file of an instrument cannot be read.
        Exception: it has no header that can be read, of whatever type its decoder raises; what
            reads the levels tells why.
    """
    suffix = file.suffix.lower()
    if suffix in HDF5:
        if not can_be_read("driver.experiment.images.headers:read_levels", file, dataset):
            raise Refused("what no library can read", "an HDF5 file that is whole")
        with h5py.File(file, "r") as content:
            node = content[dataset]
            if not isinstance(node, h5py.Dataset):
                raise LookupError(dataset)
            return node.shape, node.dtype
    if suffix == ".npy":
        with file.open("rb") as content:
            shape, _, kind = npy_header(content)
        return shape, kind
    if suffix == ".png":
        with file.open("rb") as picture:
            start = picture.read(25)
        size = int.from_bytes(start[20:24]), int.from_bytes(start[16:20])
        return size, np.dtype(np.uint16 if start[24] == 16 else np.uint8)
    if suffix in INSTRUMENTS:
        rows, columns = instrument_size(file)
        return (1, rows, columns), np.dtype(np.float64)
    with tifffile.TiffFile(file) as tiff:
        _refuse_circle(tiff)
        first = tiff.pages.first
        shape = tuple(map(int, first.shape))
        # Pages are counted only where one of them is no more than can be.
        number = 1 if _too_many(shape, np.dtype(first.dtype)) else len(tiff.pages)
        return (number, *shape), np.dtype(first.dtype)


def read_levels(file: str, dataset: str) -> None:
    """Read all levels of a dataset, some at a time, as a process of its own reads them first.

    Args:
        file: an HDF5 file.
        dataset: name of the dataset.
    """
    with h5py.File(file, "r") as content:
        content.visititems(lambda name, child: None)
        node = content.get(dataset) if dataset else None
        if not isinstance(node, h5py.Dataset) or _too_many(node.shape, node.dtype):
            return
        for index in range(node.shape[0]) if node.ndim == 3 else [()]:
            node[index]


def _refuse_circle(tiff: tifffile.TiffFile) -> None:
    """Refuse a file whose pages follow each other without end, which tifffile would read for ever.

    Raises:
        Refused: a page is followed by one before it.
    """
    kind, file = tiff.tiff, tiff.filehandle
    seen: set[int] = set()

    def number(at: int, size: int, code: str) -> int:
        file.seek(at)
        value: int = struct.unpack(code, file.read(size))[0]
        return value

    try:
        page = number(8 if kind.is_bigtiff else 4, kind.offsetsize, kind.offsetformat)
        while page and page not in seen:
            seen.add(page)
            end = (
                page
                + kind.tagnosize
                + kind.tagsize * number(page, kind.tagnosize, kind.tagnoformat)
            )
            page = number(end, kind.offsetsize, kind.offsetformat)
    except struct.error:
        return  # it ends too early, as tifffile tells
    if page:
        raise Refused("pages that follow each other in a circle", "a TIFF file that is whole")


def npy_header(content: BinaryIO) -> tuple[tuple[int, ...], bool, np.dtype[np.generic]]:
    """Shape, whether columns come first, and type of an NPY file, which is read to its levels.

    Raises:
        ValueError: it has no header that is known.
    """
    read: Any = np.lib.format
    version = read.read_magic(content)
    known = {(1, 0): read.read_array_header_1_0, (2, 0): read.read_array_header_2_0}
    if version not in known:
        raise ValueError(f"version {version[0]} of the format")
    shape, fortran, kind = known[version](content)
    return shape, fortran, kind


def refuse_large(file: Path, dataset: str = "") -> None:
    """Refuse a file whose header tells more than any height map has.

    Raises:
        Refused: a frame has more than MOST_PIXELS, or all together more than MOST_BYTES.
    """
    try:
        shape, kind = header(file, dataset)
    except Refused:
        raise
    except Exception:  # every decoder raises its own types at what it cannot read
        return
    if _too_many(shape, kind):
        sizes, gigabytes = " × ".join(map(str, shape)), prod(shape) * kind.itemsize / 1e9
        raise Refused(
            f"{sizes} pixels by its header, {gigabytes:.3g} GB of levels",
            f"at most {MOST_PIXELS:.0e} pixels a frame and {MOST_BYTES / 1e9:.0f} GB a file",
        )


def _too_many(shape: tuple[int, ...], kind: np.dtype[np.generic]) -> bool:
    return prod(shape[-2:]) > MOST_PIXELS or prod(shape) * kind.itemsize > MOST_BYTES
