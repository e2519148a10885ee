"""The process that `meshes.guarded` has read files first: a request a line, an answer a line."""

from __future__ import annotations

import importlib
import json
import os
import resource
import signal
import sys
from typing import BinaryIO

from meshes.guarded import IN_TRIAL

_MEMORY = 1_500_000_000  # bytes beside what the process has, for a file without content
_PER_BYTE = 20  # bytes for each one of a file


def main() -> None:
    """Answer requests until nobody is left to ask."""
    os.environ[IN_TRIAL] = str(os.getpid())
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    answers = os.fdopen(os.dup(1), "wb", buffering=0)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in (1, 2):  # libraries print
        os.dup2(nowhere, stream)
    answers.write(b"ready\n")
    for line in sys.stdin.buffer:
        _answer(json.loads(line), answers)


def _answer(request: list[object], answers: BinaryIO) -> None:
    reader, path, *words, seconds = request
    module, _, name = str(reader).partition(":")
    read = getattr(importlib.import_module(module), name)
    # Where nobody is left to end it, it ends itself.
    signal.alarm(int(float(str(seconds))) + 2)
    resource.setrlimit(resource.RLIMIT_AS, (_allowed(str(path)), resource.RLIM_INFINITY))
    try:
        read(path, *words)
        answer = b"read\n"
    except MemoryError:
        answer = b"no memory\n"
    except (Exception, SystemExit):  # the one who asks meets it, too, and tells it
        answer = b"read\n"
    resource.setrlimit(resource.RLIMIT_AS, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    signal.alarm(0)
    answers.write(answer)


def _allowed(path: str) -> int:
    """Memory that the process may have for a file [bytes]."""
    with open("/proc/self/statm", encoding="ascii") as file:
        now = int(file.read().split()[0]) * resource.getpagesize()
    return now + _MEMORY + _PER_BYTE * os.path.getsize(path)


if __name__ == "__main__":
    main()
