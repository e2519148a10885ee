"""One process at a time computes a job; the others wait, and take its result.

The lock is a file beside the folder of the job, made by exclusive creation, which works on file
systems that several machines share, where locks of the system may reach one machine only. Its
holder touches it as long as it lives. Where that holder is a process of this machine that has
ended, the lock is free at once; where it is on another machine, once nobody has touched the file
for the time `LEASE`, as the waiting process itself has seen it: no clocks are compared.

The lock saves work and guards nothing. A holder that was held up, and whose lock was taken, ends
its job all the same: the first folder that gets the name of the job stays (`folder.settle`).
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryFile

import psutil
from filelock import LeaseSettingsMismatch, SoftFileLease, Timeout

from solver_adapters.jobs.machine import SPACE, this_machine

LOCK = ".lock"
"""Ending of the lock of a job, after its key."""
LEASE = 120.0
"""How long a lock that nobody touches keeps others away [s]; network file systems tell late."""
SILENT = 3600.0
"""After how long without a touch a holder on another machine is taken for dead at a look [s]."""
_SHORTEST, _LONGEST, _SHARE = 0.05, 1.0, 0.02  # time between two tries [s], as a share of the wait


@contextmanager
def sole_process(folder: Path, waiting: Callable[[str], None]) -> Iterator[None]:
    """Keep other processes, and other threads of this one, from a job; wait where one has it.

    Args:
        folder: that of the job, named by its key; the one around it is made where it is missing.
        waiting: called from time to time with who has it, in words. What it raises ends the wait.

    Raises:
        OSError: the lock cannot be written.
    """
    lease, path = _lease(folder), _path(folder)
    path.parent.mkdir(parents=True, exist_ok=True)
    begun = changed = time.monotonic()
    state = _state(path)
    while not _taken(lease):
        waiting(_holder(lease))
        now, found = time.monotonic(), _state(path)
        if found != state:
            state, changed = found, now
        elif _has_died(lease) or now - changed > 2 * LEASE:
            # Network file systems that cannot exchange two names leave the lock in place.
            lease.force_break()
        time.sleep(min(max(_SHARE * (now - begun), _SHORTEST), _LONGEST))
    try:
        yield
    finally:
        lease.release()


@contextmanager
def at_rest(folder: Path) -> Iterator[bool]:
    """Keep others from a job as long as it is looked at, and say whether that could be had.

    Args:
        folder: that of the job, named by its key.

    Raises:
        OSError: the lock cannot be written.
    """
    lease = _lease(folder)
    ours = _taken(lease)
    if not ours and (_has_died(lease) or _silent(_path(folder), _time_of_files(folder.parent))):
        lease.force_break()
        ours = _taken(lease)
    try:
        yield ours
    finally:
        lease.release()


def holder_of(folder: Path) -> str:
    """Return who has a job, in words, "" for nobody.

    Args:
        folder: that of the job, named by its key.
    """
    lease = _lease(folder)
    return "" if _silent(_path(folder), time.time()) or _has_died(lease) else _holder(lease)


def _lease(folder: Path) -> SoftFileLease:
    return SoftFileLease(_path(folder), lease_duration=LEASE)


def _path(folder: Path) -> Path:
    return folder.with_name(folder.name + LOCK)


def _taken(lease: SoftFileLease) -> bool:
    try:
        lease.acquire(blocking=False)
    except (Timeout, LeaseSettingsMismatch):  # the latter by a version with another `LEASE`
        return False
    return True


def _has_died(lease: SoftFileLease) -> bool:
    """Whether the holder was a process of this machine that has ended."""
    owner = lease.owner
    return (
        owner is not None and owner.hostname == this_machine() and not psutil.pid_exists(owner.pid)
    )


def _holder(lease: SoftFileLease) -> str:
    owner = lease.owner
    if owner is None:
        return "another process"
    machine = owner.hostname.partition(SPACE)[0]
    return f"process {owner.pid} on {machine}"


def _state(path: Path) -> tuple[int, int] | None:
    """Return what a touch of a file changes, None where there is none."""
    with suppress(OSError):
        told = path.lstat()
        return told.st_mtime_ns, told.st_ino
    return None


def _silent(path: Path, now: float) -> bool:
    """Whether there is no lock, or nobody has touched it for long."""
    state = _state(path)
    return state is None or now - 1e-9 * state[0] > SILENT


def _time_of_files(folder: Path) -> float:
    """Return the time by the clock of a file system, which need not be that of this machine [s]."""
    with TemporaryFile(dir=folder) as file:
        return os.fstat(file.fileno()).st_mtime
