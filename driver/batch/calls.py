"""One job carried out: calls of prismid in processes of their own, which a job cannot outlive."""

from __future__ import annotations

import fcntl
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from pathlib import Path
from signal import Signals
from time import monotonic, sleep
from typing import IO

from driver.batch.jobs import Job
from driver.common.parallel import THREAD_VARIABLES

_EVERY = 0.2  # s between two looks whether a call has ended
_AGAIN = 10.0  # s after which a process that was asked to end is asked once more
_SELDOM, _STALE = 10.0, 300.0  # s between two looks how old the token is, and how old it may be
_STOPPED = 130  # exit code after a signal
_TOLD = "prismid: "  # what a line begins with that tells why a call failed
_KILLED = (
    "ended by the system with {}, most likely for want of memory; expected a smaller "
    "execution.jobs, or a larger cluster.memory_GB"
)
_ENDED_BY_SIGNAL = "stopped from outside; run again to go on"


@dataclass(frozen=True)
class Outcome:
    """How a job ended.

    Attributes:
        status: "done", "failed" or "stopped".
        why: one sentence or several, nothing where it is done.
        seconds: how long it took.
    """

    status: str
    why: str
    seconds: float


class Token:
    """What lets a job go on: a file, and whoever touches it.

    Args:
        path: the file; where it is gone, or was not touched for long, the job is stopped.
        clock: another file, by which the time of the file system is told.
    """

    def __init__(self, path: Path, clock: Path) -> None:
        self.path, self.clock = path, clock
        self._looked = monotonic()
        self._stale = 0

    def gone(self) -> bool:
        """Whether the job has to stop."""
        try:
            touched = self.path.stat().st_mtime
        except FileNotFoundError:
            return True
        if monotonic() - self._looked < _SELDOM:
            return False
        self._looked = monotonic()
        self.clock.touch()
        stale = self.clock.stat().st_mtime - touched > _STALE
        # A campaign that was held up has time to touch it.
        self._stale = self._stale + 1 if stale else 0
        return self._stale > 1


def carry_out(job: Job, threads: int, token: Path) -> Outcome:
    """Make the calls of a job, one after the other, until one fails.

    Args:
        job: the job.
        threads: of the numerical libraries of each process.
        token: a file; where it is gone, or was not touched for long, the job is stopped.
    """
    job.log.parent.mkdir(parents=True, exist_ok=True)
    alive = Token(token, job.lock)
    with job.lock.open("ab") as lock:
        # Its processes of an asker that was killed may be about to end.
        while not alive.gone() and not _locked(lock):
            sleep(_EVERY)
        start = monotonic()
        with job.log.open("wb") as log:
            for call in _calls_left(job):
                code = 0 if alive.gone() else _ended(call, threads, alive, log, lock)
                if alive.gone():
                    return Outcome("stopped", "", monotonic() - start)
                if code:
                    return Outcome("failed", _reason(job.log, code), monotonic() - start)
        return Outcome("done", "", monotonic() - start)


def carry_out_on_worker(job: Job, threads: int, token: Path) -> Outcome:
    """Carry out a job on a worker of Dask, which gives it back where its call was stopped.

    A queue system ends the processes of a job all at once, in no order: the worker may well live to
    tell that the case has failed.

    Raises:
        distributed.Reschedule: the job is for another worker.
    """
    from distributed import Reschedule

    outcome = carry_out(job, threads, token)
    if outcome.why == _ENDED_BY_SIGNAL:
        raise Reschedule
    return outcome


def _calls_left(job: Job) -> Sequence[Sequence[str]]:
    """Return the calls of a job; an experiment is made once, from nothing if it was cut off."""
    if job.made is None:
        return job.calls
    if job.case.is_file():
        return job.calls[1:]
    shutil.rmtree(job.made, ignore_errors=True)
    return job.calls


def _locked(file: IO[bytes]) -> bool:
    """Lock a file, if no other process holds it, and say whether."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        pass  # a file system without locks is no reason not to run
    return True


def _ended(call: Sequence[str], threads: int, alive: Token, log: IO[bytes], lock: IO[bytes]) -> int:
    """Make a call and return its exit code; it is asked to end where the token is gone.

    Its process holds the lock, too.
    """
    limits = dict.fromkeys(THREAD_VARIABLES, str(threads))
    # The folder of the call is none to import from.
    command = [sys.executable, "-P", "-m", "prismid", "--end-with-input", *call]
    with subprocess.Popen(
        command,
        stdin=subprocess.PIPE,
        stdout=log,
        stderr=log,
        env=os.environ | limits,
        pass_fds=(lock.fileno(),),
    ) as process:
        asked = -inf
        try:
            while process.poll() is None:
                sleep(_EVERY)
                # Where Python cannot raise what the signal asks for, it tells so and goes on.
                if monotonic() - asked > _AGAIN and alive.gone():
                    process.terminate()
                    asked = monotonic()
        except BaseException:
            process.terminate()
            raise
    return process.returncode


def _reason(log: Path, code: int) -> str:
    """Return why a call failed, as it has told, or by what it was ended."""
    if code < 0:
        return _KILLED.format(Signals(-code).name)
    if code == _STOPPED:
        return _ENDED_BY_SIGNAL
    lines = log.read_text("utf-8", errors="replace").splitlines()
    told = [line.removeprefix(_TOLD) for line in lines if line.startswith(_TOLD)]
    return "\n".join(told) or f"exit code {code}: {lines[-1] if lines else 'without a word'}"
