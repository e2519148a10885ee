"""What this process may use of its machine."""

from __future__ import annotations

import os
from pathlib import Path

_LIMIT = Path("/sys/fs/cgroup/memory.max")


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
