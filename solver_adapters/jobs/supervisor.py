"""Runs one program, watches its whole tree of processes, and ends it in time.

Started as a script of its own by `runner`, so that it outlives whoever asked for the job: its
standard input is a pipe that only the asker holds, and the end of that pipe (the asker says stop,
or has died, however suddenly) ends the tree. As a "subreaper" it inherits the orphans of the tree,
so that a process which left its parent and its group stays within reach. It imports nothing of
prismid and starts in a tenth of a second.

The first argument is {"command": [...], "memory": bytes, "wall_time": s | null, "cpu_time": s |
null}; the answer on standard output is {"ended": reason, "code": int, "wall": s, "cpu": s,
"memory": bytes}, where the reason is "itself", "wall_time", "cpu_time", "memory", "stop" or
"missing".
"""

from __future__ import annotations

import ctypes
import json
import os
import select
import signal
import subprocess
import sys
import time
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import psutil

_PR_SET_PDEATHSIG, _PR_SET_CHILD_SUBREAPER = 1, 36
_GRACE = 2.0  # s between asking a tree to end and ending it
_SHORTEST, _LONGEST, _SHARE = 0.05, 1.0, 0.02  # time between two looks [s], as a share of the run

_libc = ctypes.CDLL(None)


@dataclass
class _Use:
    """What the tree has used up to now: CPU time [s], most memory at a time [bytes]."""

    cpu: float = 0.0
    memory: int = 0


def _tree() -> list[psutil.Process]:
    return psutil.Process().children(recursive=True)


def _look(use: _Use) -> int:
    """Bring the use up to date; the resident memory now [bytes].

    The CPU time of a process that has ended is in its parent's account, or in ours.
    """
    own = os.times()
    cpu, memory = own.children_user + own.children_system, 0
    for process in _tree():
        try:
            with process.oneshot():
                times = process.cpu_times()
                memory += process.memory_info().rss
        except psutil.NoSuchProcess:
            continue
        cpu += times.user + times.system + times.children_user + times.children_system
    # A process may end between two looks at its tree: time never runs back.
    use.cpu, use.memory = max(use.cpu, cpu), max(use.memory, memory)
    return memory


def _reap(child: int) -> int | None:
    """Take note of ended processes; the exit code of the child if it is among them."""
    code = None
    while True:
        try:
            pid, status = os.waitpid(-1, os.WNOHANG)
        except ChildProcessError:
            return code
        if pid == 0:
            return code
        if pid == child:
            code = os.waitstatus_to_exitcode(status)


def _living() -> list[psutil.Process]:
    """Return processes of the tree that have not ended (a zombie has, its parent does not know)."""
    living = []
    for process in _tree():
        with suppress(psutil.NoSuchProcess):
            if process.status() != psutil.STATUS_ZOMBIE:
                living.append(process)
    return living


def _end_tree(child: int, grace: float) -> int | None:
    """End every process of the tree; the exit code of the child if it had not ended yet."""
    code = None
    deadline = time.monotonic() + grace
    asked: set[int] = set()
    while living := _living():
        late = time.monotonic() >= deadline
        for process in living:
            if late or process.pid not in asked:
                asked.add(process.pid)
                with suppress(psutil.NoSuchProcess):
                    process.send_signal(signal.SIGKILL if late else signal.SIGTERM)
        time.sleep(0.01)
        ended = _reap(child)
        code = ended if ended is not None else code
    return code


def _exceeded(task: dict[str, Any], use: _Use, memory: int, wall: float) -> str | None:
    if memory > task["memory"]:
        return "memory"
    if task["wall_time"] is not None and wall > task["wall_time"]:
        return "wall_time"
    if task["cpu_time"] is not None and use.cpu > task["cpu_time"]:
        return "cpu_time"
    return None


def _watch(task: dict[str, Any], child: int, wake: int, begun: float) -> tuple[str, int, _Use]:
    """Wait for the end of the child, of a limit or of the asker; why, exit code, use."""
    use, asker = _Use(), os.getppid()
    waiting = select.poll()
    for stream in (sys.stdin.fileno(), wake):
        waiting.register(stream, select.POLLIN | select.POLLHUP)
    while True:
        wall = time.monotonic() - begun
        reason = _exceeded(task, use, _look(use), wall)
        if reason is not None:
            ended = _end_tree(child, 0.0 if reason == "memory" else _GRACE)
            return reason, ended or 0, use
        interval = min(max(_SHARE * wall, _SHORTEST), _LONGEST)
        if task["wall_time"] is not None:
            interval = min(interval, max(task["wall_time"] - wall, 0.0) + 0.001)
        ready = [stream for stream, _ in waiting.poll(1000 * interval)]
        # A fork of a dead asker may still hold the pipe open.
        if sys.stdin.fileno() in ready or os.getppid() != asker:
            return "stop", _end_tree(child, _GRACE) or 0, use
        if wake in ready:
            os.read(wake, 4096)
        code = _reap(child)
        if code is not None:
            # Whatever the program has left running would never be ended otherwise.
            _end_tree(child, _GRACE)
            _look(use)
            return "itself", code, use


def _leave_with_parent() -> None:
    _libc.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)


def main() -> None:
    """Run the program in this folder, its output in stdout.txt and stderr.txt."""
    task = json.loads(sys.argv[1])
    _libc.prctl(_PR_SET_CHILD_SUBREAPER, 1)
    wake, waker = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
    signal.set_wakeup_fd(waker, warn_on_full_buffer=False)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    begun = time.monotonic()
    with open("stdout.txt", "wb") as out, open("stderr.txt", "wb") as err:
        try:
            child = subprocess.Popen(
                task["command"], stdin=subprocess.DEVNULL, stdout=out, stderr=err,
                preexec_fn=_leave_with_parent,
            )  # fmt: skip
        except OSError as error:
            err.write(f"{task['command'][0]}: {error.strerror}\n".encode())
            ended, code, use = "missing", 127, _Use()
        else:
            ended, code, use = _watch(task, child.pid, wake, begun)
            child.returncode = code
    answer = {
        "ended": ended, "code": code, "wall": time.monotonic() - begun,
        "cpu": use.cpu, "memory": use.memory,
    }  # fmt: skip
    try:
        sys.stdout.write(json.dumps(answer))
        sys.stdout.flush()
    except BrokenPipeError:
        os._exit(1)  # the asker has died: nobody waits for the answer


if __name__ == "__main__":
    main()
