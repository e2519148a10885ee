"""One run at a time works on the results of a case."""

from __future__ import annotations

import fcntl
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from driver.common.errors import InputError, sentence, why
from driver.results.files import LOCK


class BusyError(InputError):
    """Results on which another run is at work."""


def holder(results: Path) -> str:
    """Return which process is at work on a folder of results, "" for none."""
    try:
        with open(os.open(results / LOCK, os.O_RDONLY | os.O_NOFOLLOW), encoding="utf-8") as file:
            told = file.read().strip()
            # A run that begins finds nothing in the file, and is not kept from its lock.
            if told:
                fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return told
    except (OSError, ValueError):
        pass  # no run so far, or a file system without locks
    return ""


@contextmanager
def sole_run(results: Path) -> Iterator[None]:
    """Keep other runs away from a folder of results.

    The system frees the lock when its process ends, in whatever way, so that none is left behind.
    The file stays: were it removed, a run that has just opened it could lock what is gone.

    Args:
        results: the folder.

    Raises:
        BusyError: another run holds it.
        InputError: no file can be written there.
    """
    try:
        # What a link in its place leads to would be emptied.
        flags = os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_NOFOLLOW | os.O_CLOEXEC
        opened = os.fdopen(os.open(results / LOCK, flags, 0o666), "a+", encoding="utf-8")
    except OSError as error:
        if (results / LOCK).is_symlink():
            found, expected = "a link", "a file, or nothing: remove it"
            raise InputError(sentence(results / LOCK, "file", found, expected)) from None
        expected = "a folder that can be written"
        raise InputError(sentence(results, "folder", why(error), expected)) from None
    with opened as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            file.seek(0)
            holder = file.read().strip()
            raise BusyError(
                f"{results}: another run{f', {holder},' if holder else ''} is at work on it; "
                "expected none: wait for its end, or stop it"
            ) from None
        except OSError:
            # A file system without locks is no reason not to run.
            pass
        file.truncate(0)
        file.write(f"process {os.getpid()} on {socket.gethostname()}\n")
        file.flush()
        try:
            yield
        finally:
            file.truncate(0)
