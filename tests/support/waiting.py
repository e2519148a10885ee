"""A process that hears of a signal while it waits for a lock, as a run waits for its processes."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

_PACKAGES = Path(__file__).parents[2]
_WAIT = """
import os, signal, threading

number = signal.Signals[{name!r}]
signal.signal(number, signal.default_int_handler)
{prepare}
lock = threading.Lock()
lock.acquire()
threading.Timer(0.2, os.kill, (os.getpid(), number)).start()
late = threading.Timer(10.0, os._exit, (1,))
late.start()
try:
    lock.acquire()
except KeyboardInterrupt:
    late.cancel()
    print("stopped")
"""


def said_by(program: str) -> tuple[int, str]:
    """Exit code and output of a program in a process of its own."""
    ended = subprocess.run(
        [sys.executable, "-c", program],
        env={**os.environ, "PYTHONPATH": str(_PACKAGES)},
        capture_output=True,
        text=True,
        timeout=120.0,
    )
    return ended.returncode, ended.stdout


def hears_as_it_waits(prepare: str, name: str) -> bool:
    """Whether a process hears of the signal of a name while it waits, after some statements."""
    return said_by(_WAIT.format(name=name, prepare=prepare)) == (0, "stopped\n")
