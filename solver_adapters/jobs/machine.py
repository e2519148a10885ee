"""Which processes are of this machine, and whether they live."""

from __future__ import annotations

import os
import socket
from contextlib import suppress

SPACE = "?pidns-"
"""What parts the name of a machine from the space of process numbers, as `filelock` has it."""
_OUTERMOST = 0xEFFFFFFC  # Linux: the space outside of all containers


def this_machine() -> str:
    """Return the name of this machine, and in a container the space of its process numbers.

    Containers may share the name of a machine and count their processes each for itself.
    """
    space = _OUTERMOST
    with suppress(OSError):
        space = os.stat("/proc/self/ns/pid").st_ino
    return socket.gethostname() + ("" if space == _OUTERMOST else f"{SPACE}{space:x}")
