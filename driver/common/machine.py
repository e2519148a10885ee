"""What this process may use of its machine."""

from __future__ import annotations

import os
import platform
from importlib.metadata import version
from pathlib import Path

_LIMIT = Path("/sys/fs/cgroup/memory.max")
_PROCESSORS = Path("/proc/cpuinfo")
# Libraries whose versions may change the last digits of a result.
_LIBRARIES = ("numpy", "scipy", "numba", "cvxopt", "pymetis", "gmsh")


def cores() -> int:
    """Cores that this process may run on."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def memory(limit: Path = _LIMIT) -> float:
    """Memory of the machine, or as much of it as the control group of this process has [bytes].

    Args:
        limit: the file that tells the latter, where there is one.
    """
    whole = float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    try:
        return min(whole, float(limit.read_text()))
    except (OSError, ValueError):  # none, or “max”
        return whole


def computed_by(processes: int, threads: int) -> str:
    """Return what the last digits of a result may depend on: processor, libraries and threads.

    Args:
        processes: simulations side by side.
        threads: threads of each.
    """
    libraries = (f"{name} {version(name)}" for name in _LIBRARIES)
    python = f"Python {platform.python_version()}"
    return ", ".join((_processor(), python, *libraries, f"{processes} x {threads} threads"))


def _processor() -> str:
    """Name of the processor, as the system tells it."""
    try:
        lines = _PROCESSORS.read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    named = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(named, platform.machine())
