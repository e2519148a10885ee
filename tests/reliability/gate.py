"""A point of the program at which a process waits until a test lets it go on.

Every Python process whose path holds the site of a laboratory has it.
"""

from __future__ import annotations

import os
import re
import sys
import time
from pathlib import Path
from typing import Any

FOLDER, GATE = "PRISMID_LABORATORY", "PRISMID_LABORATORY_GATE"
"""Variables: the folder of the gate, and the event and the pattern of where it stands."""
EVERY = 0.02  # s


def install() -> None:
    """Put the gate that the variables ask for into this process."""
    if FOLDER not in os.environ or not os.environ.get(GATE):
        return
    folder = Path(os.environ[FOLDER])
    event, _, pattern = os.environ[GATE].partition("|")
    waiting: list[bool] = []

    def look(name: str, given: tuple[Any, ...]) -> None:
        if name != event or waiting or not re.search(pattern, _what(name, given)):
            return
        waiting.append(True)
        try:
            wait_at(folder)
        finally:
            waiting.clear()

    sys.addaudithook(look)


def _what(event: str, given: tuple[Any, ...]) -> str:
    """What an event is about: the file that is written or gets its name."""
    if event == "open":
        path, mode, flags = given
        writes = bool(flags & (os.O_WRONLY | os.O_RDWR)) if isinstance(flags, int) else False
        return str(path) if writes or "w" in str(mode) else ""
    return str(given[1] if event == "os.rename" else given[0])


def wait_at(folder: Path) -> None:
    """Wait at the gate as long as it is closed."""
    if not (folder / "closed").exists():
        return
    (folder / f"reached.{os.getpid()}").touch()
    try:
        while (folder / "closed").exists():
            time.sleep(EVERY)
    except KeyboardInterrupt:
        (folder / f"interrupted.{os.getpid()}").touch()
        raise
