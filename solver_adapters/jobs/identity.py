"""The identity of a program: what it says of its version, else a hash of its files."""

from __future__ import annotations

import hashlib
import os
import signal
import subprocess
import tempfile
from functools import lru_cache
from pathlib import Path

_LONGEST = 120.0  # s that a program may take to tell its version; containers start slowly


class NoAnswerError(Exception):
    """A program that cannot be asked for its version; the message says why."""


def told_by(call: tuple[str, ...]) -> str:
    """Ask a program for its version, once for each state of its files.

    Args:
        call: the program with its arguments.

    Raises:
        NoAnswerError: it cannot be started, or takes too long.
    """
    return _told(call, tuple(_state(Path(word)) for word in call))


@lru_cache(maxsize=32)
def _told(call: tuple[str, ...], files: tuple[tuple[int, int], ...]) -> str:
    # In a folder of its own: files of the current one are nothing to the program.
    with tempfile.TemporaryDirectory() as empty:
        try:
            asked = subprocess.Popen(
                call,
                cwd=empty,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                errors="replace",
                start_new_session=True,
            )
        except OSError as error:
            raise NoAnswerError(f"{call[0]}: {error.strerror}") from None
        try:
            return asked.communicate(timeout=_LONGEST)[0]
        except subprocess.TimeoutExpired:
            # The children of a launcher hang with it.
            os.killpg(asked.pid, signal.SIGKILL)
            asked.communicate()
            raise NoAnswerError(f"no answer within {_LONGEST:g} s") from None


def hash_of(program: tuple[str, ...]) -> str:
    """Name and hash of a program with the scripts and settings that it is called with."""
    digest = hashlib.sha256()
    for word in program:
        digest.update(_content_hash(Path(word)) if os.path.isfile(word) else word.encode())
    return f"{Path(program[0]).resolve().name} {digest.hexdigest()[:12]}"


def _content_hash(path: Path) -> bytes:
    return _hash_of(path, *_state(path))


@lru_cache(maxsize=32)
def _hash_of(path: Path, size: int, changed: int) -> bytes:
    """Hash of a file; size and time of change tell when it must be read again."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").digest()


def _state(path: Path) -> tuple[int, int]:
    """Size and time of change of a file, zeros of a word that is none."""
    try:
        stat = path.stat()
    except OSError:
        return 0, 0
    return stat.st_size, stat.st_mtime_ns
