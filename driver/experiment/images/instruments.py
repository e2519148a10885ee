"""Height maps of profilometers and atomic force microscopes, read by SurfaceTopography.

Its readers hand out lengths: pixel size, unit of the heights and offset are those of the file.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np

from driver.case.instrument_files import INSTRUMENTS
from driver.common.errors import why
from driver.experiment.images.file_frames import FileFrames, Levels
from driver.experiment.images.files import Refused
from driver.experiment.images.length_units import nanometres

_READER = "SurfaceTopography"
_SQUARE = 0.005  # difference of both pitches, which would shift a face of 200 px by one
_ONE_AT_A_TIME = Lock()  # the readers do not say that they may run side by side


def open_instrument(file: Path) -> FileFrames:
    """Return the one frame of the file of an instrument, heights in nanometres.

    A pixel that was not measured is not a number.

    Raises:
        Refused: the file or the library is not there or cannot be read, it is no height map with a
            unit of length, or its pixels are not square.
    """
    rows, columns, pixel = _size_and_pixels(file)
    if abs(pixel[0] / pixel[1] - 1.0) > _SQUARE:
        raise Refused(
            f"pixels of {pixel[1]:.6g} nm along a row and {pixel[0]:.6g} nm along a column",
            "square ones: resample the scan on square pixels, and save it as TIFF",
        )
    frame = FileFrames(
        (1, rows, columns), np.dtype(np.float64), partial(_heights, file), pixel, in_nm=True
    )
    return frame.all_read()


def instrument_size(file: Path) -> tuple[int, int]:
    """Rows and columns of a file, from its header.

    Raises:
        Refused: as of `open_instrument`.
    """
    rows, columns, _ = _size_and_pixels(file)
    return rows, columns


def _size_and_pixels(file: Path) -> tuple[int, int, tuple[float, float]]:
    """Rows, columns and pitch of the rows and of the columns [nm]."""
    with _channel(file) as channel:
        if channel.dim != 2:
            raise Refused(f"a profile of {channel.nb_grid_pts[0]} points", "a map of heights")
        unit = _unit(channel)
        columns, rows = map(int, channel.nb_grid_pts)
        along_x, along_y = map(float, channel.physical_sizes)
        return rows, columns, (unit * along_y / rows, unit * along_x / columns)


def _heights(file: Path, index: int) -> Levels:
    with _channel(file) as channel:
        topography = channel.topography()
        heights = np.ma.filled(np.ma.asarray(topography.heights(), dtype=np.float64), np.nan)
        # The reader has (x, y): x along a row, y from one row to the next.
        return np.ascontiguousarray(_unit(topography) * heights.T)


def _unit(content: Any) -> float:
    """Nanometres of the unit of lengths and heights."""
    unit = content.unit
    known = nanometres(unit) if isinstance(unit, str) else None
    if known is None:
        raise Refused(f"a channel of the unit {unit}", "heights in a unit of length")
    return known


@contextmanager
def _channel(file: Path) -> Iterator[Any]:
    """Open the height channel of a file, one at a time.

    Raises:
        Refused: there is no library, no file or no such channel, or the library fails.
    """
    with _ONE_AT_A_TIME, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            library = import_module(f"{_READER}.IO")
        except ImportError:
            raise Refused(
                "the file of an instrument", "the library that reads it: pip install "
                "'prismid[instruments]'",
            ) from None  # fmt: skip
        try:
            kind = INSTRUMENTS[file.suffix.lower()]
            with library.open_topography(str(file), format=kind) as reader:
                yield reader.default_channel
        except Refused:
            raise
        except Exception as error:  # each of its readers raises its own types
            said = f"{type(error).__name__}: {why(error)}"[:200]
            raise Refused(
                f"what {_READER} {version(_READER)} cannot read ({said})",
                "a height map of an instrument; or the scan saved as TIFF by its own program",
            ) from None
