"""Frames of a file by its kind, in levels as stored: TIFF, PNG, NPY, HDF5."""

from __future__ import annotations

from math import prod
from pathlib import Path

import imagecodecs
import numpy as np

from driver.case.instrument_files import INSTRUMENTS
from driver.common.errors import why
from driver.experiment.images.file_frames import (
    FileFrames,
    Levels,
    contiguous,
    in_memory,
    stack_shape,
)
from driver.experiment.images.files import HDF5, Refused
from driver.experiment.images.hdf5 import open_hdf5
from driver.experiment.images.headers import npy_header, refuse_large
from driver.experiment.images.instruments import open_instrument
from driver.experiment.images.tiff import HEIGHTS, open_tiff

_PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_PNG_GREY = 0
_PNG_COLOURS = {2: "RGB", 3: "a palette", 4: "grey with alpha", 6: "RGBA"}


def open_file(file: Path, dataset: str = "") -> FileFrames:
    """Frames of one file, of which every one can be read; never rescaled.

    Args:
        file: a .tif, .tiff, .png, .npy, .h5, .hdf5, .hdf or .mat file, or one of an instrument.
        dataset: name of the dataset in an HDF5 file.

    Raises:
        Refused: the file is unreadable, truncated, empty, too large, in colour or not of numbers,
            its pages differ, or it holds no dataset of that name.
    """
    refuse_large(file, dataset)
    suffix = file.suffix.lower()
    if suffix in HDF5:
        return open_hdf5(file, dataset)
    if suffix in INSTRUMENTS:
        return open_instrument(file)
    return {".npy": _open_npy, ".png": _open_png}.get(suffix, open_tiff)(file)


def _open_png(file: Path) -> FileFrames:
    first = _read_png(file)
    return FileFrames((1, *first.shape), first.dtype, lambda index: _read_png(file))


def _read_png(file: Path) -> Levels:
    try:
        data = file.read_bytes()
    except (OSError, ValueError) as error:
        raise Refused(why(error), "a PNG file that can be read") from None
    if len(data) < 33 or not data.startswith(_PNG_SIGNATURE):
        raise Refused("no PNG header", "a PNG file")
    bits, colour = data[24], data[25]
    if colour != _PNG_GREY:
        raise Refused(f"{_PNG_COLOURS.get(colour, 'colours')}", HEIGHTS)
    if bits not in (1, 8, 16):  # decoders stretch 2 and 4 bits to 8
        raise Refused(f"{bits} bits a pixel", "8 or 16")
    try:
        levels = imagecodecs.png_decode(data)
    except Exception as error:  # the types of errors are made at run time
        raise Refused(why(error), "a PNG file that is whole") from None
    return np.asarray(levels > 0 if bits == 1 else levels)


def _open_npy(file: Path) -> FileFrames:
    try:
        with file.open("rb") as content:
            shape, fortran, dtype = npy_header(content)
            offset = content.tell()
        whole = offset + prod(shape) * dtype.itemsize <= file.stat().st_size
        if whole and not fortran and not dtype.hasobject:
            return contiguous(file, offset, stack_shape(shape, dtype), dtype)
        return in_memory(np.asarray(np.load(file, allow_pickle=False)))
    except Exception as error:  # the header is an expression of Python, with all its errors
        raise Refused(why(error), "an NPY file of numbers that can be read") from None
