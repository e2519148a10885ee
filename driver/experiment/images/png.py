"""Frames of PNG files: grey levels, or heights where the file tells which range they span."""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import imagecodecs
import numpy as np

from driver.common.errors import why
from driver.experiment.images.file_frames import FileFrames, Levels
from driver.experiment.images.files import Refused
from driver.experiment.images.length_units import nanometres
from driver.experiment.images.tiff import HEIGHTS

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_GREY = 0
_COLOURS = {2: "RGB", 3: "a palette", 4: "grey with alpha", 6: "RGBA"}
# Keywords of Gwyddion: heights at level 0 and at the largest level of the type, sizes of the scan.
_LOW, _HIGH, _UNIT = "Gwy::ZMin", "Gwy::ZMax", "Gwy::ZUnit"
_WIDTH, _HEIGHT, _UNIT_XY = "Gwy::XReal", "Gwy::YReal", "Gwy::XYUnit"
_LONGEST = 4096  # bytes of a text that tells a number or a unit


@dataclass(frozen=True)
class _Scale:
    """Heights at level 0 and at the largest level [nm]."""

    low: float
    high: float


def open_png(file: Path) -> FileFrames:
    """Return the one frame of a file.

    Programs that stretch each image to all levels of its type write the range of the heights
    beside it: texts of Gwyddion, or the chunk pCAL of the PNG standard. With it the frame is
    handed out in nanometres.

    Raises:
        Refused: the file cannot be read, is damaged or in colour, or its range is no length.
    """
    data = _content(file)
    levels = _decoded(data)
    scale, pixel = _scale(data), _pixel(data, levels.shape)
    shape = (1, *levels.shape)
    if scale is None or levels.dtype.kind != "u":
        return FileFrames(shape, levels.dtype, partial(_levels, file), pixel)
    return FileFrames(shape, np.dtype(np.float64), partial(_heights, file), pixel, in_nm=True)


def _levels(file: Path, index: int) -> Levels:
    """Levels of the one frame of a file."""
    return _decoded(_content(file))


def _heights(file: Path, index: int) -> Levels:
    """Heights [nm] of a file that tells its range, which may be another one than before."""
    data = _content(file)
    levels, scale = _decoded(data), _scale(data)
    if scale is None:
        raise Refused("no range of the heights", "the file that was read at first")
    share = levels.astype(np.float64) / (2.0 ** (8 * levels.dtype.itemsize) - 1.0)
    return np.asarray(scale.low + (scale.high - scale.low) * share)


def _content(file: Path) -> bytes:
    try:
        data = file.read_bytes()
    except (OSError, ValueError) as error:
        raise Refused(why(error), "a PNG file that can be read") from None
    if len(data) < 33 or not data.startswith(_SIGNATURE):
        raise Refused("no PNG header", "a PNG file")
    return data


def _decoded(data: bytes) -> Levels:
    bits, colour = data[24], data[25]
    if colour != _GREY:
        raise Refused(f"{_COLOURS.get(colour, 'colours')}", HEIGHTS)
    if bits not in (1, 8, 16):  # decoders stretch 2 and 4 bits to 8
        raise Refused(f"{bits} bits a pixel", "8 or 16")
    try:
        levels = imagecodecs.png_decode(data)
    except Exception as error:  # the types of errors are made at run time
        raise Refused(why(error), "a PNG file that is whole") from None
    return np.asarray(levels > 0 if bits == 1 else levels)


def _scale(data: bytes) -> _Scale | None:
    """Return the heights at both ends of the type, None where the file is silent.

    Raises:
        Refused: they have a unit, but of no length.
    """
    texts = _texts(data)
    ends = [_number(texts.get(key)) for key in (_LOW, _HIGH)]
    unit = texts.get(_UNIT)
    if None in ends:
        ends, unit = _calibrated(data)
    low, high = ends
    # Numbers without a unit, such as those of a mask, are levels of another kind.
    if low is None or high is None or high == low or not (unit and unit.strip()):
        return None
    length = nanometres(unit)
    if length is None:
        raise Refused(
            f"levels that stand for {low:g} to {high:g} {unit.strip()}",
            "heights in a unit of length",
        )
    return _Scale(low * length, high * length)


def _calibrated(data: bytes) -> tuple[list[float | None], str | None]:
    """Both ends and their unit as a linear pCAL chunk of the standard tells them."""
    for kind, content in _chunks(data):
        name, _, rest = content.partition(b"\0")
        if kind != b"pCAL" or not name or len(rest) < 10:
            continue
        first, last, equation, count = struct.unpack(">iiBB", rest[:10])
        unit, *numbers = rest[10:].split(b"\0")
        if equation or count != 2 or len(numbers) != 2 or last <= first:
            continue
        base, slope = (_number(text.decode("latin-1")) for text in numbers)
        if base is not None and slope is not None:
            # The first parameter is reached at the stored level 0, whose original is `first`.
            at = (first / (last - first), last / (last - first))
            return [base + slope * share for share in at], unit.decode("latin-1")
    return [None, None], None


def _pixel(data: bytes, shape: tuple[int, ...]) -> tuple[float, float] | None:
    """Pitch of rows and of columns [nm], None where the file does not tell it."""
    texts = _texts(data)
    width, height = (_number(texts.get(key)) for key in (_WIDTH, _HEIGHT))
    length = nanometres(texts.get(_UNIT_XY))
    if not width or not height or length is None:
        return None
    rows, columns = shape
    return length * height / rows, length * width / columns


def _texts(data: bytes) -> Mapping[str, str]:
    """Return short texts of a file by their keywords."""
    texts = {}
    for kind, content in _chunks(data):
        key, _, text = content.partition(b"\0")
        if kind == b"zTXt" and text[:1] == b"\0":
            try:
                text = zlib.decompressobj().decompress(text[1:], _LONGEST)
            except zlib.error:
                continue
        elif kind == b"iTXt" and text[:1] == b"\0":
            text = text[2:].partition(b"\0")[2].partition(b"\0")[2]
        elif kind != b"tEXt":
            continue
        coding = "utf-8" if kind == b"iTXt" else "latin-1"
        texts[key.decode("latin-1")] = text[:_LONGEST].decode(coding, errors="replace")
    return texts


def _chunks(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Kind and content of each chunk that is not pixels."""
    at = len(_SIGNATURE)
    while at + 12 <= len(data):
        size = int.from_bytes(data[at : at + 4])
        kind = data[at + 4 : at + 8]
        if kind != b"IDAT":
            yield kind, data[at + 8 : at + 8 + size]
        at += 12 + size


def _number(text: str | None) -> float | None:
    try:
        value = float(text or "")
    except ValueError:
        return None
    return value if math.isfinite(value) else None
