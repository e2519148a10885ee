"""Results on the disk, held against what their stage wrote: there, damaged, changed."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from itertools import count
from pathlib import Path

from driver.common.atomic_write import place_below
from driver.experiment.images.files import matches
from driver.results.files import EXTENDED, READ_BACK, edited
from driver.results.stage_record import Done

UNREADABLE = "unreadable"
_BLOCK = 2**20  # bytes that are read at a time


def content_hash(path: Path) -> str:
    """Hash of a file, or of all files of a folder or pattern with their names."""
    try:
        if path.is_file():
            with path.open("rb") as file:
                return hashlib.file_digest(file, "sha256").hexdigest()
        files = [file for file in sorted(matches(path)) if file.is_file()]
        parts = [f"{file.name} {content_hash(file)}" for file in files]
    except (OSError, ValueError):
        return UNREADABLE  # the stage that needs it says so, with the key of the case
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def are_readable(entry: Done, results: Path) -> bool:
    """Whether the results of a stage are there, and those that others read as they were written."""
    return all((results / name).is_file() for name in entry["outputs"]) and not any(
        name.endswith(READ_BACK) and Path(name).parent == Path()
        for name, _ in changes(entry, results)
    )


def differences(entry: Done, results: Path) -> Iterator[tuple[str, str]]:
    """Yield the results of a stage that are not as it wrote them, each with what it is now.

    The extended model, as a case and as decks, is there to be edited, and may be.
    """
    for name in entry["outputs"]:
        if not (results / name).is_file():
            yield name, "is not there"
    for name, state in changes(entry, results):
        if state == "is damaged" or not (name == EXTENDED or Path(name).parent != Path()):
            yield name, state


def changes(entry: Done, results: Path) -> Iterator[tuple[str, str]]:
    """Yield the results of a stage that have changed since it wrote them, each with how."""
    for name, digest in entry.get("digests", {}).items():
        path = place_below(results, name)
        if path.is_file() and content_hash(path) != digest:
            yield name, "is damaged" if _is_nothing(path) else "has changed since it was written"


def set_edited_aside(old: Done | None, results: Path) -> Iterator[str]:
    """Rename what somebody has edited, before its stage writes it anew; yield what was done."""
    for name, state in tuple(changes(old, results)) if old else ():
        if state == "is damaged":
            continue
        path = results / name
        names = (edited(path, number) for number in count())
        kept = next(other for other in names if not other.exists())
        path.rename(kept)
        yield f"{path} {state}: it is kept as {kept.name}"


def _is_nothing(path: Path) -> bool:
    """Whether a file is empty or holds zeros alone, as after a crash: nobody has edited it."""
    try:
        with path.open("rb") as file:
            while block := file.read(_BLOCK):
                if any(block):
                    return False
    except OSError:
        return False
    return True
