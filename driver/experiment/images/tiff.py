"""Frames of a TIFF file."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from threading import Lock
from xml.etree import ElementTree

import numpy as np
import tifffile
from numpy.typing import NDArray

from driver.common.errors import why
from driver.common.file_kinds import TIFF_FILE, kind_by_content
from driver.experiment.images.file_frames import FileFrames, Levels, contiguous, stack_shape
from driver.experiment.images.files import Refused
from driver.experiment.images.length_units import nanometres

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
            kind = "" if isinstance(error, OSError) else kind_by_content(file)
            if kind and kind != TIFF_FILE:
                raise Refused(kind, "a TIFF file, or the ending of that kind") from None
            raise Refused(why(error), "a TIFF file that is whole: copy or save it anew") from None
    if log.messages:
        raise Refused(f"“{log.messages[0]}”", "a TIFF file that is whole: copy or save it anew")
    return frames


def _opened(file: Path) -> FileFrames:
    with tifffile.TiffFile(file) as tiff:
        _refuse_colours(tiff.pages.first)
        _refuse_lossy(tiff.pages.first)
        _refuse_turned(tiff.pages.first)
        sizes = sorted({page.shape for page in tiff.pages})
        if len(sizes) > 1 or len(tiff.series) > 1:
            raise Refused(f"pages of unlike size or type {sizes}", "pages that are all alike")
        series = tiff.series[0]
        shape = stack_shape(series.shape, series.dtype, series.axes)
        if tiff.is_ome and any(page is not None and page.parent is not tiff for page in series):
            raise Refused("pages that lie in other files", "a folder or pattern that names these")
        pixel = _pixel_size(tiff)
        size = shape[0] * shape[1] * shape[2] * series.dtype.itemsize
        if series.dataoffset is None:
            by_page = FileFrames(shape, series.dtype, _Pages(tiff, file, shape))
            return replace(by_page.all_read(), pixel_nm=pixel)
        if series.dataoffset + size > file.stat().st_size:
            tiff.asarray()  # says what is wrong with it
        order = np.dtype(series.dtype).newbyteorder(tiff.byteorder)
        stored = replace(contiguous(file, series.dataoffset, shape, order), pixel_nm=pixel)
    if order.isnative:
        return stored
    native = order.newbyteorder("=")
    return replace(stored, dtype=native, read=partial(_in_order, stored, native))


def _in_order(stored: FileFrames, native: np.dtype[np.generic], index: int) -> Levels:
    """Levels of a frame in the byte order of this machine."""
    return stored.read(index).astype(native)


class _Pages:
    """Reads a frame of a file page by page; another process opens the file anew."""

    def __init__(self, tiff: tifffile.TiffFile, file: Path, shape: tuple[int, int, int]) -> None:
        self._series, self._handle = tiff.series[0], tiff.filehandle
        self._file, self._shape, self._lock = file, shape, Lock()

    def __call__(self, index: int) -> Levels:
        with self._lock:
            closed = self._handle.closed
            if closed:
                self._handle.open()
            try:
                page = self._series[index]
                if page is None:
                    raise Refused(f"no page of frame {index}", "a page of each frame")
                return np.asarray(page.asarray(maxworkers=1)).reshape(self._shape[1:])
            finally:
                if closed:
                    self._handle.close()

    def __reduce__(self) -> tuple[Callable[..., _Pages], tuple[Path, tuple[int, int, int]]]:
        """Return what makes it in another process."""
        return _pages_of, (self._file, self._shape)


def _pages_of(file: Path, shape: tuple[int, int, int]) -> _Pages:
    with tifffile.TiffFile(file) as tiff:
        return _Pages(tiff, file, shape)


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
    if kind is tifffile.PHOTOMETRIC.PALETTE and _is_grey(page.colormap):
        return
    if kind is not tifffile.PHOTOMETRIC.MINISBLACK:
        raise Refused(f"levels that mean {kind.name}", "MINISBLACK: the level grows with height")


def _is_grey(palette: NDArray[np.uint16] | None) -> bool:
    """Whether a palette shows each level as the grey of it, so that it says nothing."""
    if palette is None:
        return False
    n = palette.shape[1]
    # Writers multiply bytes by 256 or by 257.
    ramp = np.arange(n)[np.newaxis] * (2**16 / n)
    return bool(np.all(np.abs(palette - ramp) < 2**16 / n))


def _refuse_lossy(page: tifffile.TiffPage) -> None:
    kind = tifffile.COMPRESSION(page.compression).name
    if "JPEG" in kind and "LOSSLESS" not in kind:
        raise Refused(
            f"levels compressed by {kind}, which changes them",
            "a compression without loss (LZW, deflate) or none",
        )


def _refuse_turned(page: tifffile.TiffPage) -> None:
    """Refuse a page that some viewers mirror or turn: origin_pixel would be of either picture."""
    tag = page.tags.get("Orientation")
    if tag is not None and tag.value != tifffile.ORIENTATION.TOPLEFT:
        found = getattr(tag.value, "name", tag.value)
        raise Refused(
            f"the orientation {found}, by which some programs mirror or turn the rows and columns "
            "that are stored",
            "TOPLEFT: save the file anew as it is shown, without the tag",
        )


def _pixel_size(tiff: tifffile.TiffFile) -> tuple[float, float] | None:
    """Pitch of rows and columns [nm] that ImageJ or OME has stated, for they mean the object."""
    if tiff.is_ome and tiff.ome_metadata:
        pixels = ElementTree.fromstring(tiff.ome_metadata).find(".//{*}Pixels")
        stated = {} if pixels is None else pixels.attrib
        sizes = [
            (float(stated.get(f"PhysicalSize{axis}", 0)), stated.get(f"PhysicalSize{axis}Unit"))
            for axis in "YX"
        ]
        pitches = [size * (nanometres(unit or "um") or 0.0) for size, unit in sizes]
    elif tiff.is_imagej and tiff.imagej_metadata:
        unit = nanometres(tiff.imagej_metadata.get("unit")) or 0.0
        tags = tiff.pages.first.tags
        ratios = [tags[f"{axis}Resolution"].value if f"{axis}Resolution" in tags else (0, 0)
                  for axis in "YX"]  # fmt: skip
        pitches = [unit * below / above if above else 0.0 for above, below in ratios]
    else:
        return None
    return (pitches[0], pitches[1]) if min(pitches) > 0 else None
