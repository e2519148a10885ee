"""Kernels compiled in a process of their own, so that the first run has the numbers of all later.

Numba joins what it compiles to what it has compiled before in the same process: a kernel may then
call a copy of another one that was optimised apart, whose sums round otherwise than those of the
copy that is kept on disk. A process that only loads kernels has but one copy of each.
"""

from __future__ import annotations

import atexit
import importlib
import os
import pickle
import queue
import subprocess
import sys
import threading
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from time import monotonic, sleep
from typing import Any, BinaryIO

from meshes.guarded import end_process

_SERVE = "from solver_adapters.compiling_process import serve; serve()"
_IDLE = 30.0  # s without a kernel to compile after which the process ends
_DONE, _FAILED, _GONE = b"1", b"0", b""

_named: dict[tuple[str, str, int], list[Any]] = {}  # the compilers of each function, as they came
_serves = False


@dataclass
class _Compiler:
    """The process that compiles, started when a kernel is not on disk.

    Attributes:
        lock: of one kernel at a time.
        process: None before the first kernel, and after one that has ended it.
        owner: number of the process that has started it.
        used: when it has answered last [s].
    """

    lock: threading.Lock = field(default_factory=threading.Lock)
    process: subprocess.Popen[bytes] | None = None
    owner: int = 0
    used: float = 0.0

    def has_compiled(self, message: bytes) -> bool:
        """Whether the process has compiled what a message asks for."""
        with self.lock:
            if self.process is not None and self.owner == os.getpid():
                # It may have been ended since the last kernel, for want of memory.
                answer = self._answer(self.process, message)
                if answer != _GONE:
                    return answer == _DONE
            try:
                self.process, self.owner = _started(), os.getpid()
            except OSError:  # no further process may be had
                return False
            threading.Thread(target=self._end_idle, args=(self.process,), daemon=True).start()
            return self._answer(self.process, message) == _DONE

    def _answer(self, process: subprocess.Popen[bytes], message: bytes) -> bytes:
        assert process.stdin is not None and process.stdout is not None
        answer = _GONE
        try:
            process.stdin.write(message)
            answer = process.stdout.read(1)
        except BrokenPipeError:
            pass
        finally:
            # After Ctrl-C an answer is still to come, which is none to the next request.
            if answer == _GONE:
                self.end()
            self.used = monotonic()
        return answer

    def _end_idle(self, process: subprocess.Popen[bytes]) -> None:
        """End a process that has had no kernel to compile for long."""
        while True:
            sleep(max(0.0, self.used + _IDLE - monotonic()))
            with self.lock:
                if self.process is not process:
                    return
                if monotonic() - self.used >= _IDLE:
                    self.end()
                    return

    def end(self) -> None:
        """End the process."""
        if self.process is not None and self.owner == os.getpid():
            end_process(self.process)
            self.process = None


_COMPILER = _Compiler()
atexit.register(_COMPILER.end)


def _started() -> subprocess.Popen[bytes]:
    # It takes nothing from the current folder, where anybody's files lie.
    search = os.pathsep.join(path for path in sys.path if path)
    return subprocess.Popen(
        [sys.executable, "-P", "-c", _SERVE],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,  # where this process has none, a pipe would take its number
        bufsize=0,
        start_new_session=True,  # Ctrl-C is for this process
        env=os.environ | {"PYTHONPATH": search},
    )


def found_elsewhere(
    dispatcher: Any, compilation: Callable[[], AbstractContextManager[None]]
) -> Any:
    """Return a compiler that has another process compile what is not on disk, and loads that.

    Args:
        dispatcher: what `numba.njit` has made of a function, with a cache on disk.
        compilation: a context in which this process waits for the other one.
    """
    function = dispatcher.py_func
    alike = _named.setdefault(_place(function), [])
    alike.append(dispatcher)
    dispatcher._cache = _Cache(dispatcher._cache, function, len(alike) - 1, compilation)
    return dispatcher


def made_by(dispatcher: Any, factory: Callable[..., Any], arguments: tuple[int, ...]) -> None:
    """Say by what another process makes a kernel that no module has from its start.

    Args:
        dispatcher: of the kernel.
        factory: a function of a module.
        arguments: what it was called with.
    """
    cache = getattr(dispatcher, "_cache", None)  # where nothing is compiled there is none
    if isinstance(cache, _Cache):
        cache.name = (factory.__module__, factory.__qualname__, arguments)


class _Cache:
    """The cache of a kernel, which asks the other process for what it lacks."""

    def __init__(
        self,
        cache: Any,
        function: Any,
        number: int,
        compilation: Callable[[], AbstractContextManager[None]],
    ) -> None:
        self._cache, self._compilation = cache, compilation
        self.name: tuple[Any, ...] = (*_place(function), number)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._cache, name)

    def load_overload(self, signature: Any, context: Any) -> Any:
        """Return the compiled kernel, None where the caller has to compile it itself."""
        kept = self._cache.load_overload(signature, context)
        if kept is not None or _serves:
            return kept
        with self._compilation():
            compiled = _asked((self.name, signature))
        return self._cache.load_overload(signature, context) if compiled else None


def _place(function: Any) -> tuple[str, str, int]:
    return function.__module__, function.__qualname__, function.__code__.co_firstlineno


def _asked(request: tuple[tuple[Any, ...], Any]) -> bool:
    """Whether the other process has compiled a kernel."""
    try:
        packed = pickle.dumps(request, pickle.HIGHEST_PROTOCOL)
    except (pickle.PicklingError, TypeError, AttributeError):
        return False  # a type that only this process knows
    return _COMPILER.has_compiled(len(packed).to_bytes(8, "little") + packed)


def serve() -> None:
    """Compile what is asked for at the standard input, and end with the process that asks."""
    global _serves
    _serves = True
    asked, replies = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb", 0)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # libraries print
    requests: queue.Queue[bytes] = queue.Queue()
    threading.Thread(target=_listen, args=(asked, requests), daemon=True).start()
    while True:
        replies.write(_DONE if _compiled(requests.get()) else _FAILED)


def _listen(asked: BinaryIO, requests: queue.Queue[bytes]) -> None:
    while header := asked.read(8):
        requests.put(asked.read(int.from_bytes(header, "little")))
    os._exit(0)


def _compiled(packed: bytes) -> bool:
    """Compile a kernel; where that fails, the process that calls it is told by its own attempt."""
    try:
        name, signature = pickle.loads(packed)
        _dispatcher(*name).compile(signature)
    except Exception:
        return False
    return True


def _dispatcher(module: str, function: str, place: Any, number: int | None = None) -> Any:
    """Return the kernel of a name: where a function stands, or what its factory is called with."""
    there = importlib.import_module(module)
    if number is None:
        return getattr(there, function)(*place)
    return _named[module, function, place][number]
