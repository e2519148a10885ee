"""Which files a path of the case names: one, a folder, a pattern, a dataset of HDF5."""

from __future__ import annotations

import glob
import os
import re
from collections.abc import Sequence
from pathlib import Path

from driver.case.instrument_files import INSTRUMENTS
from driver.common.errors import why

MATLAB = ".mat"
HDF5 = (".h5", ".hdf5", ".hdf", MATLAB)
PLAIN = (".tif", ".tiff", ".png", ".npy", *HDF5)
SUFFIXES = (*PLAIN, *INSTRUMENTS)
_DATASET = re.compile(rf"^(.*(?:{'|'.join(map(re.escape, HDF5))})):(.+)$", re.IGNORECASE)


class Refused(Exception):
    """A file that cannot be used: what was found and what was expected.

    Who read it knows the key of the case, and makes the sentence.
    """

    def __init__(self, found: str, expected: str) -> None:
        super().__init__(found, expected)
        self.found, self.expected = found, expected


def split_dataset(path: str | Path) -> tuple[str, str]:
    """File (folder, pattern) and dataset of a path such as `images.h5:/frames`.

    Returns:
        Both; the dataset is empty where the path names none.
    """
    match = _DATASET.match(str(path))
    return (match[1], match[2]) if match else (str(path), "")


def files_of(path: str) -> list[Path]:
    """Return image files of a path, without dataset, in natural order (frame 9 before frame 10).

    Raises:
        Refused: there are none, or the path cannot be looked up.
    """
    kinds = f"{', '.join(PLAIN)} or instrument"
    try:
        given = Path(path)
        if given.is_file():
            return [given]
        candidates = matches(given)
        # Names that begin with a dot are leftovers of file managers, not images.
        files = [
            file
            for file in candidates
            if file.suffix.lower() in SUFFIXES and file.name[0] != "." and file.is_file()
        ]
    except (OSError, ValueError) as error:
        raise Refused(why(error), f"a file, a folder or a pattern of {kinds} files") from None
    if not files:
        what = f"no image among {len(candidates)} files" if candidates else "no image"
        raise Refused(what, f"a file, a folder or a pattern of {kinds} files")
    return sorted(files, key=lambda file: (natural(file.name), file.name))


def matches(path: Path) -> list[Path]:
    """Return what a folder holds, or what a pattern matches.

    Brackets in a folder that is there are no pattern.

    Raises:
        OSError, ValueError: it cannot be looked up.
    """
    if path.is_dir():
        return list(path.iterdir())
    parent = str(path.parent)
    folder = glob.escape(parent) if path.parent.is_dir() else parent
    return [Path(name) for name in glob.glob(os.path.join(folder, path.name))]


def natural(name: str) -> list[tuple[int, str]]:
    """Key that sorts names by the numbers in them."""
    return [
        (int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d+)", name)
    ]


def gap(names: Sequence[str]) -> str:
    """Return the first gap in names that are numbered in equal steps, as “a.tif follows b.tif”.

    Args:
        names: file names in natural order.

    Returns:
        An empty text where the names have no gap, or more or less than one number that counts.
    """
    split = [re.split(r"(\d+)", name) for name in names]
    if len({tuple(parts[::2]) for parts in split}) != 1:
        return ""
    columns = list(zip(*(map(int, parts[1::2]) for parts in split), strict=True))
    counting = [column for column in columns if len(set(column)) > 1]
    if len(counting) != 1:
        return ""
    steps = [b - a for a, b in zip(counting[0], counting[0][1:], strict=False)]
    usual = max(set(steps), key=lambda step: (steps.count(step), -step))
    for before, after, step in zip(names, names[1:], steps, strict=False):
        if step > usual:
            return f"{after} follows {before}"
    return ""
