"""One file of height maps in, its levels out, as stored: TIFF, PNG, NPY, HDF5."""

from __future__ import annotations

import logging
from pathlib import Path

import h5py
import imagecodecs
import numpy as np
import tifffile
from numpy.typing import NDArray

from driver.common.errors import why
from driver.experiment.images.files import HDF5, Refused
from driver.experiment.images.headers import refuse_large

Levels = NDArray[np.generic]

_PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_PNG_GREY = 0
_PNG_COLOURS = {2: "RGB", 3: "a palette", 4: "grey with alpha", 6: "RGBA"}
_EXPECTED = "heights, one number a pixel"


def read_file(file: Path, dataset: str = "") -> Levels:
    """Levels of one file, never rescaled.

    Args:
        file: a .tif, .tiff, .png, .npy, .h5, .hdf5 or .hdf file.
        dataset: name of the dataset in an HDF5 file.

    Returns:
        Shape (n, rows, cols), of the type that is stored.

    Raises:
        Refused: the file is unreadable, truncated, empty, too large, in colour or not of numbers,
            its pages differ, or it holds no dataset of that name.
    """
    refuse_large(file, dataset)
    suffix = file.suffix.lower()
    if suffix in HDF5:
        levels = _read_hdf5(file, dataset)
    else:
        levels = {".npy": _read_npy, ".png": _read_png}.get(suffix, _read_tiff)(file)
    if levels.dtype.kind not in "buif":
        raise Refused(f"values of type {levels.dtype}", "integers or floats")
    stack = levels[np.newaxis] if levels.ndim == 2 else levels
    if stack.ndim != 3:
        raise Refused(
            f"an array of shape {levels.shape}",
            "heights of shape (rows, columns) or (frames, rows, columns)",
        )
    if stack.size == 0:
        raise Refused("no pixel", "at least one frame")
    return stack


class _ErrorLog(logging.Handler):
    """Keeps what tifffile only logs: it cuts a truncated stack short without an exception."""

    def __init__(self) -> None:
        super().__init__(logging.ERROR)
        self.messages: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.messages.append(record.getMessage())


def _read_tiff(file: Path) -> Levels:
    log, logger = _ErrorLog(), logging.getLogger("tifffile")
    propagate, logger.propagate = logger.propagate, False
    logger.addHandler(log)
    try:
        with tifffile.TiffFile(file) as tiff:
            first = tiff.pages.first
            _refuse_colours(first)
            sizes = sorted({page.shape for page in tiff.pages})
            if len(sizes) > 1 or len(tiff.series) > 1:
                raise Refused(f"pages of unlike size or type {sizes}", "pages that are all alike")
            levels = tiff.asarray()
    except Refused:
        raise
    except Exception as error:  # every decoder behind tifffile raises its own type
        raise Refused(why(error), "a TIFF file that can be read") from None
    finally:
        logger.removeHandler(log)
        logger.propagate = propagate
    if log.messages:
        raise Refused(f"“{log.messages[0]}”", "a TIFF file that is whole")
    return np.asarray(levels)


def _refuse_colours(page: tifffile.TiffPage) -> None:
    """Three pages of heights are three frames; three samples of one page are a colour."""
    kind = tifffile.PHOTOMETRIC(page.photometric)
    if page.samplesperpixel > 1:
        planes = page.planarconfig == tifffile.PLANARCONFIG.SEPARATE
        hint = "; frames that were saved as colour planes are saved anew as grey pages"
        raise Refused(
            f"{page.samplesperpixel} colour channels ({kind.name})",
            _EXPECTED + (hint if planes else ""),
        )
    if kind is not tifffile.PHOTOMETRIC.MINISBLACK:
        raise Refused(f"levels that mean {kind.name}", "MINISBLACK: the level grows with height")


def _read_png(file: Path) -> Levels:
    try:
        data = file.read_bytes()
    except (OSError, ValueError) as error:
        raise Refused(why(error), "a PNG file that can be read") from None
    if len(data) < 33 or not data.startswith(_PNG_SIGNATURE):
        raise Refused("no PNG header", "a PNG file")
    bits, colour = data[24], data[25]
    if colour != _PNG_GREY:
        raise Refused(f"{_PNG_COLOURS.get(colour, 'colours')}", _EXPECTED)
    if bits not in (1, 8, 16):  # decoders stretch 2 and 4 bits to 8
        raise Refused(f"{bits} bits a pixel", "8 or 16")
    try:
        levels = imagecodecs.png_decode(data)
    except Exception as error:  # the types of errors are made at run time
        raise Refused(why(error), "a PNG file that is whole") from None
    return np.asarray(levels > 0 if bits == 1 else levels)


def _read_npy(file: Path) -> Levels:
    try:
        return np.asarray(np.load(file, allow_pickle=False))
    except Exception as error:  # the header is an expression of Python, with all its errors
        raise Refused(why(error), "an NPY file of numbers that can be read") from None


def _read_hdf5(file: Path, dataset: str) -> Levels:
    try:
        with h5py.File(file, "r") as content:
            node = content.get(dataset) if dataset else None
            if isinstance(node, h5py.Dataset):
                return np.asarray(node[()])
            names: list[str] = []
            content.visititems(
                lambda name, child: (
                    names.append(f"/{name}") if isinstance(child, h5py.Dataset) else None
                )
            )
    except (OSError, ValueError, RuntimeError, KeyError, TypeError, MemoryError) as error:
        raise Refused(why(error), "an HDF5 file that can be read") from None
    found = f'no dataset "{dataset}"' if dataset else "no name of a dataset"
    known = ", ".join(names) if names else "a dataset, but the file holds none"
    raise Refused(found, f"{file.name}:NAME with NAME one of {known}")
