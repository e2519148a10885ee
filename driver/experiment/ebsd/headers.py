"""What an EBSD file says of itself, before its points are read."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import h5py

from driver.case.grains import EbsdFrame
from driver.common.errors import show, why
from driver.common.file_kinds import kind_by_content
from driver.experiment.images.files import Refused

MOST_POINTS = 10_000_000
"""Points beyond which it is no map of a grain or two."""
MOST_BYTES = 4_000_000_000
"""Bytes of a file, and of what is read of a compressed one."""
ANG, CTF, HDF5 = ".ang", ".ctf", (".h5", ".hdf5", ".h5ebsd")
EXPECTED = "an EBSD map in a file .ang, .ctf or .h5"
_PATTERNS = ("RawPatterns", "EBSDPatterns")  # images of the detector, which nobody reads here
_MOST_LINES = 1000  # of a header
_ANG_ENTRY = re.compile(r"^#\s*(GRID|XSTEP|YSTEP|NCOLS_ODD|NCOLS_EVEN|NROWS):\s*(\S+)")
# What programs write that hand a map of any maker on (orix/io/plugins/ang.py and ctf.py).
_HANDED_ON = re.compile(r"EMsoft|ACOM|mtex|Column names: phi1, Phi, phi2", re.IGNORECASE)
_OF_EDAX, _OF_CHANNEL = "# TEM_PIXperUM", "Channel Text File"
_CTF_ENTRY = re.compile(r"^(XCells|YCells|XStep|YStep|AcqE[123])\s+(\S+)")
_EDAX: tuple[EbsdFrame, ...] = ("edax",)
_CHANNEL: tuple[EbsdFrame, ...] = ("oxford", "bruker")
CTF_COLUMNS = "Phase\tX\tY"
_BLOCK = 1 << 22


@dataclass(frozen=True)
class Header:
    """What the header of a text file says of the grid; 0 or None where it says nothing.

    Attributes:
        step: of the grid along x and y, in the unit of the file.
        points: of the whole grid.
        surface: Euler angles of the acquired surface, of an Oxford file [degrees].
        makers: of the system whose software has written the file, none where that is not known.
    """

    step: tuple[float, float] | None = None
    points: int = 0
    surface: tuple[float, float, float] = (0.0, 0.0, 0.0)
    makers: tuple[EbsdFrame, ...] = ()


def refuse_unfit_file(file: Path) -> None:
    """Refuse what is no file of a map, or one that is larger than any map of a grain.

    Args:
        file: the file.

    Raises:
        Refused: there is none, it is of another kind, cannot be read, or holds too much.
    """
    if file.suffix.lower() not in (ANG, CTF, *HDF5):
        hint = "; Oxford's own files are exported as .ctf, EDAX's as .ang"
        raise Refused(f'the ending "{file.suffix}"', EXPECTED + hint)
    try:
        if not file.is_file():
            raise Refused("nothing" if not file.exists() else "no file", EXPECTED)
        _refuse_another_kind(file)
        size = file.stat().st_size
        _refuse_more(size, 0)
        if file.suffix.lower() in HDF5:
            _refuse_more(*_sizes_in(file))
        else:
            _refuse_more(size, _lines(file))
    except (OSError, ValueError) as error:
        raise Refused(why(error), EXPECTED + " that can be read") from None


def _refuse_another_kind(file: Path) -> None:
    """Refuse a file whose content is not of the kind that its ending says.

    Raises:
        Refused: it is empty, a picture, an archive or the like.
        OSError: it cannot be read.
    """
    kind = kind_by_content(file)
    if file.suffix.lower() in HDF5:
        if not h5py.is_hdf5(file):
            raise Refused(kind or "no HDF5 file", f"{EXPECTED} that is whole: export it anew")
    elif kind:
        raise Refused(kind, f"{EXPECTED} that is whole: export the map with its points")


def read_header(file: Path) -> Header:
    """Read what a text file says of its grid.

    Args:
        file: an .ang or .ctf file.

    Raises:
        Refused: a number of it is none, or a step of its grid is not above zero.
    """
    ang = file.suffix.lower() == ANG
    entries = dict(_entries(file, ang))
    names = ("XSTEP", "YSTEP") if ang else ("XStep", "YStep")
    steps = tuple(_number(entries, name) for name in names if name in entries)
    surface = tuple(
        _number(entries, f"AcqE{axis}") if entries and not ang else 0.0 for axis in "123"
    )
    for name, step in zip(names, steps, strict=False):
        if step < 0:
            raise Refused(
                f"{name} = {step:g}, so that its coordinates are mirrored and its angles are not",
                "a right-handed map, with x and y that grow: it is exported anew, not flipped",
            )
    known = (steps[0], steps[1]) if len(steps) == 2 and min(steps) > 0 else None
    return Header(
        known, _points(entries, ang), (surface[0], surface[1], surface[2]), makers_of(file)
    )


def makers_of(file: Path) -> tuple[EbsdFrame, ...]:
    """Return the makers of the system whose software has written a text file of a map.

    Oxford's and Bruker's .ctf are alike, and so are their frames.

    Args:
        file: whatever its kind; it may be absent.

    Returns:
        None of them where that is not known.
    """
    ang = file.suffix.lower() == ANG
    if not ang and file.suffix.lower() != CTF:
        return ()
    mark, makers = (_OF_EDAX, _EDAX) if ang else (_OF_CHANNEL, _CHANNEL)
    try:
        lines = list(_header_lines(file, ang))
    except (OSError, ValueError):
        return ()
    handed_on = any(map(_HANDED_ON.search, lines))
    return makers if not handed_on and any(line.startswith(mark) for line in lines) else ()


def _header_lines(file: Path, ang: bool) -> Iterator[str]:
    with file.open(encoding="utf-8", errors="replace") as text:
        for line in itertools.islice(text, _MOST_LINES):
            if not line.startswith("#") if ang else line.startswith(CTF_COLUMNS):
                return
            yield line


def _entries(file: Path, ang: bool) -> Iterator[tuple[str, str]]:
    pattern = _ANG_ENTRY if ang else _CTF_ENTRY
    for line in _header_lines(file, ang):
        match = pattern.match(line)
        if match:
            yield match[1], match[2]


def _number(entries: dict[str, str], name: str) -> float:
    text = entries.get(name, "0")
    try:
        number = float(text.replace(",", "."))
        if math.isfinite(number):
            return number
    except ValueError:
        pass
    raise Refused(f"{name} = {show(text)} in its header", "a number")


def _points(entries: dict[str, str], ang: bool) -> int:
    """Points of the whole grid; rows of a hexagonal one are long and short in turn."""
    if not ang:
        return int(_number(entries, "XCells") * _number(entries, "YCells"))
    rows, odd = int(_number(entries, "NROWS")), int(_number(entries, "NCOLS_ODD"))
    even = int(_number(entries, "NCOLS_EVEN")) if entries.get("GRID") == "HexGrid" else odd
    return (rows + 1) // 2 * odd + rows // 2 * even


def _lines(file: Path) -> int:
    with file.open("rb") as content:
        return sum(block.count(b"\n") for block in iter(lambda: content.read(_BLOCK), b""))


def _sizes_in(file: Path) -> tuple[int, int]:
    """Bytes of all that is read of an HDF5 file, and the entries of the longest array."""
    sizes: list[tuple[int, int]] = []

    def look(name: str, node: h5py.Group | h5py.Dataset) -> None:
        if isinstance(node, h5py.Dataset) and name.split("/")[-1] not in _PATTERNS and node.shape:
            sizes.append((node.size * node.dtype.itemsize, node.shape[0]))

    with h5py.File(file, "r") as content:
        content.visititems(look)
    return sum(size for size, _ in sizes), max((length for _, length in sizes), default=0)


def _refuse_more(size: int, points: int) -> None:
    if points > MOST_POINTS + _MOST_LINES or size > MOST_BYTES:
        counted = f"{points:.3g} points, " if points else ""
        raise Refused(
            f"{counted}{size / 1e9:.3g} GB",
            f"at most {MOST_POINTS:.0e} points and {MOST_BYTES / 1e9:.0f} GB: the part of the map "
            "around the specimen is enough",
        )
