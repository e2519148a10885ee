"""Frames of a file by its kind, in levels as stored: TIFF, PNG, NPY, HDF5."""

from __future__ import annotations

from math import prod
from pathlib import Path

import numpy as np

from driver.case.instrument_files import INSTRUMENTS
from driver.common.errors import why
from driver.experiment.images.file_frames import (
    FileFrames,
    contiguous,
    in_memory,
    stack_shape,
)
from driver.experiment.images.files import HDF5, Refused
from driver.experiment.images.hdf5 import open_hdf5
from driver.experiment.images.headers import npy_header, refuse_large
from driver.experiment.images.instruments import open_instrument
from driver.experiment.images.png import open_png
from driver.experiment.images.tiff import open_tiff


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
    return {".npy": _open_npy, ".png": open_png}.get(suffix, open_tiff)(file)


def _open_npy(file: Path) -> FileFrames:
    try:
        with file.open("rb") as content:
            shape, fortran, dtype = npy_header(content)
            offset = content.tell()
        whole = offset + prod(shape) * dtype.itemsize <= file.stat().st_size
        if whole and not fortran and not dtype.hasobject:
            return contiguous(file, offset, stack_shape(shape, dtype), dtype)
        return in_memory(np.asarray(np.load(file, allow_pickle=False)))
    except Refused:
        raise
    except Exception as error:  # the header is an expression of Python, with all its errors
        raise Refused(why(error), "an NPY file of numbers that can be read") from None
