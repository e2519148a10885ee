"""Folders of the user: configuration and cache, and what takes their place where there is no home.

A user without an entry in the table of users, as a number that a container is started with, has no
home; that of another may be read-only.
"""

from __future__ import annotations

import os
import stat
import tempfile
from collections.abc import Iterator
from pathlib import Path

from platformdirs import site_config_path, user_cache_path, user_config_path

_NAME = "prismid"


def config_folder() -> Path:
    """Return the folder of the user's configuration; that of the machine where he has none."""
    try:
        folder = user_config_path(_NAME)
    except RuntimeError:
        return site_config_path(_NAME)
    # Where “~” stands for nothing, the folder of the call would be asked for what its user says.
    return folder if folder.is_absolute() else site_config_path(_NAME)


def cache_folder(stated: str | None = None) -> Path | None:
    """Return a folder that can be written and outlasts this process, or None.

    Args:
        stated: a folder that the user names; his cache folder comes after it, then a temporary one.
    """
    return next((folder for folder in _caches(stated) if _writable(folder)), None)


def can_keep(program: str) -> bool:
    """Whether a program can keep its configuration and its cache in folders of the user."""
    try:
        return all(_writable(folder(program)) for folder in (user_config_path, user_cache_path))
    except RuntimeError:
        return False


def _caches(stated: str | None) -> Iterator[Path]:
    if stated:
        yield Path(os.path.abspath(stated))
    try:
        yield user_cache_path(_NAME)
    except RuntimeError:
        pass
    try:
        # Where no temporary folder can be written Python names the folder of the call.
        if Path(tempfile.gettempdir()) == Path.cwd():
            return
        temporary = Path(tempfile.gettempdir(), f"{_NAME}-{os.getuid()}")
        temporary.mkdir(mode=0o700, exist_ok=True)
        # Code is loaded from there: it is nobody else's, and nobody else writes into it.
        about = temporary.lstat()
    except OSError:
        return
    if stat.S_ISDIR(about.st_mode) and about.st_uid == os.getuid() and not about.st_mode & 0o022:
        yield temporary


def _writable(folder: Path) -> bool:
    if not folder.is_absolute():
        return False
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False
