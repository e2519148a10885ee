"""The folder of a virtual experiment, which holds a whole one or none."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from driver.case.model import CASE_FILE, SCHEMA_FILE
from driver.common.errors import InputError, sentence
from driver.results.files import (
    FLATS_TIF,
    HISTORY_CSV,
    IMAGES_TIF,
    LABELS_TIF,
    REPEATS_TIF,
    TRUTH,
    TRUTH_H5,
    remove_folder,
    working_folder,
)

_ASIDE = working_folder("virtual")
# All but the case, which comes last: with it the experiment is whole.
_MOVED_BEFORE = frozenset(
    (IMAGES_TIF, REPEATS_TIF, FLATS_TIF, LABELS_TIF, HISTORY_CSV, TRUTH, TRUTH_H5, SCHEMA_FILE)
)


def refuse_what_is_there(folder: Path) -> None:
    """Refuse a folder that holds anything but what a process has left that was killed.

    Raises:
        InputError: it does, or is none.
    """
    if not folder.exists():
        return
    there = set(os.listdir(folder)) if folder.is_dir() else {""}
    unfinished = _ASIDE in there and there - {_ASIDE} <= _MOVED_BEFORE
    if there and not unfinished:
        raise InputError(sentence(folder, "--to", "something there", "an empty or a new folder"))


@contextmanager
def whole_or_none(folder: Path) -> Iterator[Path]:
    """Return a folder to write in, whose files are in their place once the block has ended.

    Args:
        folder: their place; what a process has left there that was killed is removed.

    Raises:
        InputError: it holds something else by now, or another process writes there.
    """
    folder.mkdir(parents=True, exist_ok=True)
    opened = os.open(folder, os.O_RDONLY)
    try:
        _lock(opened, folder)
        refuse_what_is_there(folder)
        aside = folder / _ASIDE
        remove_folder(aside)
        for name in os.listdir(folder):
            (folder / name).unlink()
        aside.mkdir()
        try:
            yield aside
            for file in sorted(aside.iterdir(), key=lambda file: file.name == CASE_FILE):
                file.replace(folder / file.name)
        except BaseException:
            for name in _MOVED_BEFORE:
                (folder / name).unlink(missing_ok=True)
            raise
        finally:
            remove_folder(aside)
    finally:
        os.close(opened)


def _lock(opened: int, folder: Path) -> None:
    """Keep other processes away, until this one closes the folder or ends."""
    try:
        fcntl.flock(opened, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        found = "another process that writes there"
        raise InputError(sentence(folder, "--to", found, "a folder of its own")) from None
    except OSError:
        pass  # a file system without locks is no reason not to write
