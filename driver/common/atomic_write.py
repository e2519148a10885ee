"""Files that are there whole or as they were before, in the place that is meant and no other."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from driver.common.errors import InputError, sentence


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file so that it is there whole or as it was before.

    A link in its place is replaced, and what it leads to stays as it is.
    """
    partial = path.with_name(path.name + ".partial")
    partial.unlink(missing_ok=True)
    try:
        with partial.open("xb") as file:
            file.write(content.encode() if isinstance(content, str) else content)
        os.replace(partial, path)
    except BaseException as error:
        with suppress(OSError):
            partial.unlink(missing_ok=True)
        if isinstance(error, OSError):  # a full disk names no file
            raise OSError(error.errno, error.strerror, str(path)) from None
        raise


def place_below(folder: Path, name: str | Path) -> Path:
    """Return the path of a file below a folder, which no link on the way leads out of.

    Raises:
        InputError: one of the folders between them is a link.
    """
    place = folder
    for part in Path(name).parts[:-1]:
        place /= part
        refuse_link(place)
    return folder / name


def refuse_link(place: Path) -> None:
    """Refuse to write in what is elsewhere.

    Raises:
        InputError: it is a link.
    """
    if place.is_symlink():
        found, expected = f"a link to {place.readlink()}", "none: remove the link"
        raise InputError(sentence(place, "file or folder", found, expected))
