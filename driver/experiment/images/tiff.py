"""Frames of a TIFF file."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Lock

import numpy as np
import tifffile

from driver.common.errors import why
from driver.experiment.images.file_frames import FileFrames, Levels, contiguous, stack_shape
from driver.experiment.images.files import Refused

HEIGHTS = "heights, one number a pixel"


def open_tiff(file: Path) -> FileFrames:
    """Frames of a TIFF file, of which every one can be read.

    Raises:
        Refused: it is unreadable, truncated or in colour, or its pages differ.
    """
    with _told(log := _ErrorLog()):
        try:
            frames = _opened(file)
        except Refused:
            raise
        except Exception as error:  # every decoder behind tifffile raises its own type
            raise Refused(why(error), "a TIFF file that can be read") from None
    if log.messages:
        raise Refused(f"“{log.messages[0]}”", "a TIFF file that is whole")
    return frames


def _opened(file: Path) -> FileFrames:
    with tifffile.TiffFile(file) as tiff:
        _refuse_colours(tiff.pages.first)
        sizes = sorted({page.shape for page in tiff.pages})
        if len(sizes) > 1 or len(tiff.series) > 1:
            raise Refused(f"pages of unlike size or type {sizes}", "pages that are all alike")
        series = tiff.series[0]
        shape = stack_shape(series.shape, series.dtype, series.axes)
        size = shape[0] * shape[1] * shape[2] * series.dtype.itemsize
        if series.dataoffset is None:
            return _by_page(tiff, series, shape).all_read()
        if series.dataoffset + size > file.stat().st_size:
            tiff.asarray()  # says what is wrong with it
        order = np.dtype(series.dtype).newbyteorder(tiff.byteorder)
        stored = contiguous(file, series.dataoffset, shape, order)
    if order.isnative:
        return stored
    native = order.newbyteorder("=")
    return FileFrames(shape, native, lambda index: stored.read(index).astype(native))


def _by_page(
    tiff: tifffile.TiffFile, series: tifffile.TiffPageSeries, shape: tuple[int, int, int]
) -> FileFrames:
    lock, handle = Lock(), tiff.filehandle

    def read(index: int) -> Levels:
        with lock:
            closed = handle.closed
            if closed:
                handle.open()
            try:
                page = series[index]
                if page is None:
                    raise Refused(f"no page of frame {index}", "a page of each frame")
                return np.asarray(page.asarray(maxworkers=1)).reshape(shape[1:])
            finally:
                if closed:
                    handle.close()

    return FileFrames(shape, series.dtype, read)


class _ErrorLog(logging.Handler):
    """Keeps what tifffile only logs: it cuts a truncated stack short without an exception."""

    def __init__(self) -> None:
        super().__init__(logging.ERROR)
        self.messages: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.messages.append(record.getMessage())


@contextmanager
def _told(log: _ErrorLog) -> Iterator[None]:
    logger = logging.getLogger("tifffile")
    propagate, logger.propagate = logger.propagate, False
    logger.addHandler(log)
    try:
        yield
    finally:
        logger.removeHandler(log)
        logger.propagate = propagate


def _refuse_colours(page: tifffile.TiffPage) -> None:
    """Three pages of heights are three frames; three samples of one page are a colour."""
    kind = tifffile.PHOTOMETRIC(page.photometric)
    if page.samplesperpixel > 1:
        planes = page.planarconfig == tifffile.PLANARCONFIG.SEPARATE
        hint = "; frames that were saved as colour planes are saved anew as grey pages"
        raise Refused(
            f"{page.samplesperpixel} colour channels ({kind.name})",
            HEIGHTS + (hint if planes else ""),
        )
    if kind is not tifffile.PHOTOMETRIC.MINISBLACK:
        raise Refused(f"levels that mean {kind.name}", "MINISBLACK: the level grows with height")
