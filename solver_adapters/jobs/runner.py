"""Running a program to its end, its limits or the end of this process."""

from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from solver_adapters.jobs.status import Status

STDOUT, STDERR = "stdout.txt", "stderr.txt"
MB = 1e6  # bytes

_WAIT = 0.2  # s
_SUPERVISOR = Path(__file__).with_name("supervisor.py")
_STATUS = {
    "wall_time": Status.OUT_OF_TIME,
    "cpu_time": Status.OUT_OF_TIME,
    "memory": Status.OUT_OF_MEMORY,
    "missing": Status.COMMAND_MISSING,
    "stop": Status.KILLED,
}
_FAULTS = (signal.SIGSEGV, signal.SIGBUS, signal.SIGFPE, signal.SIGILL, signal.SIGABRT)
CRASH_CODES = frozenset({-s for s in _FAULTS} | {128 + s for s in _FAULTS})
"""Exit codes of a program that ended itself by a fault, as the system and as a shell reports it."""
_FROM_OUTSIDE = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
KILL_CODES = frozenset({-s for s in _FROM_OUTSIDE} | {128 + s for s in _FROM_OUTSIDE})
"""Exit codes of a program that was ended from outside."""


@dataclass(frozen=True)
class Limits:
    """What a job may use.

    Attributes:
        memory: resident memory of all its processes together [MB].
        wall_time: wall-clock time [s], or None.
        cpu_time: CPU time of all its processes together [s], or None.
    """

    memory: float
    wall_time: float | None = None
    cpu_time: float | None = None


@dataclass(frozen=True)
class Ended:
    """How a program ended.

    Attributes:
        status: why, as far as the operating system knows, or None: then its log must tell.
        code: exit code, negative for a signal.
        limit: the limit that ended it ("wall_time", "cpu_time" or "memory"), or None.
        wall: wall-clock time [s].
        cpu: CPU time of all its processes [s].
        memory: most resident memory at a time that was seen [MB].
    """

    status: Status | None
    code: int
    limit: str | None
    wall: float
    cpu: float
    memory: float


def run_program(
    command: Sequence[str],
    folder: Path,
    limits: Limits,
    environment: Mapping[str, str],
    waiting: Callable[[], None] = lambda: None,
) -> Ended:
    """Run a program in a folder; its output is kept there in stdout.txt and stderr.txt.

    The program and all that it starts form a tree in a session of its own, which a supervising
    process ends as soon as a limit is passed or this process stops, dies or is interrupted.

    Args:
        command: program and arguments.
        folder: where it runs.
        limits: what it may use.
        environment: variables that are added to those of this process.
        waiting: called from time to time; what it raises ends the tree and is raised here. So a
            thread is stopped that Ctrl-C does not reach.
    """
    task = {
        "command": list(command),
        "memory": limits.memory * MB,
        "wall_time": limits.wall_time,
        "cpu_time": limits.cpu_time,
    }
    supervisor = subprocess.Popen(
        [sys.executable, "-I", str(_SUPERVISOR), json.dumps(task)],
        cwd=folder,
        env={**os.environ, **environment},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        start_new_session=True,
    )
    assert supervisor.stdin is not None and supervisor.stdout is not None
    try:
        while not select.select([supervisor.stdout], [], [], _WAIT)[0]:
            waiting()
        answer = supervisor.stdout.read()
        if not answer:
            # The supervisor itself was killed, and cannot end the tree any more.
            with suppress(ProcessLookupError):
                os.killpg(supervisor.pid, signal.SIGKILL)
    finally:
        # Where the wait was interrupted, the end of this pipe makes the supervisor end the tree.
        supervisor.stdin.close()
        supervisor.wait()
        supervisor.stdout.close()
    if not answer:
        return Ended(Status.KILLED, -signal.SIGKILL, None, 0.0, 0.0, 0.0)
    return _understand(json.loads(answer))


def _understand(answer: Mapping[str, Any]) -> Ended:
    ended, code = answer["ended"], answer["code"]
    status = _STATUS.get(ended)
    if status is None and code in KILL_CODES:
        status = Status.KILLED
    limit = ended if ended in ("wall_time", "cpu_time", "memory") else None
    return Ended(status, code, limit, answer["wall"], answer["cpu"], answer["memory"] / MB)
