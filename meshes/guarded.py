"""Files of unknown origin, read by a process of its own before this one reads them.

The libraries behind MED and HDF5 end the process at some damaged files, take all memory or never
come back. A process that only tries them is what ends then, and this one can say so.
"""

from __future__ import annotations

import atexit
import json
import os
import select
import subprocess
import sys
import threading
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

_ROOT = Path(__file__).resolve().parents[1]
# Of the processor, for a file without content and for what it has; of the clock so many times it.
_SECONDS, _BYTES_PER_SECOND, _LOADED = 8.0, 5e6, 10.0
_START = 300.0  # s until the process has loaded what reads, on a loaded machine
_GONE = b""


@dataclass
class _Trials:
    """The process that tries files, started when the first one is tried.

    Attributes:
        lock: of one file at a time.
        process: None before the first file, and after one that has ended it.
        owner: number of the process that has started it.
        known: what became of each state of a file.
    """

    lock: threading.Lock = field(default_factory=threading.Lock)
    process: subprocess.Popen[bytes] | None = None
    owner: int = 0
    known: dict[tuple[object, ...], bool] = field(default_factory=dict)

    def outcome(self, request: bytes, seconds: float) -> bool:
        """Whether the process has come back from a request."""
        if self.process is None or self.owner != os.getpid():
            self.process, self.owner = self._started(), os.getpid()
        process = self.process
        assert process.stdin is not None
        answer = _GONE
        try:
            process.stdin.write(request)
            process.stdin.flush()
            if _line(process, _START) != _GONE:
                answer = _line(process, _LOADED * seconds)
        except BrokenPipeError:
            pass
        finally:
            # After Ctrl-C an answer is still to come, which is none to the next request.
            if answer == _GONE:
                self.end()
        return answer == b"read\n"

    def _started(self) -> subprocess.Popen[bytes]:
        path = os.pathsep.join(filter(None, (str(_ROOT), os.environ.get("PYTHONPATH"))))
        process = subprocess.Popen(
            [sys.executable, "-P", "-m", "meshes.trial_reader"],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
            bufsize=0,  # an answer that lies in a buffer is not seen to be there
            start_new_session=True,  # Ctrl-C is for this process
            env=os.environ | {"PYTHONPATH": path},
        )  # fmt: skip
        if _line(process, _START) == _GONE:
            end_process(process)
            raise OSError(f"no process that reads files first could be started: {sys.executable}")
        return process

    def end(self) -> None:
        """End the process."""
        if self.process is not None and self.owner == os.getpid():
            end_process(self.process)
            self.process = None


def end_process(process: subprocess.Popen[bytes]) -> None:
    """End a process that answers requests."""
    process.kill()
    process.wait()
    for stream in (process.stdin, process.stdout):
        if stream is not None:
            with suppress(BrokenPipeError):
                stream.close()


_TRIALS = _Trials()
atexit.register(_TRIALS.end)


def can_be_read(reader: str, path: Path, *words: str) -> bool:
    """Whether a process comes back from reading a file, with what it holds or with an error.

    What it was told of a file is kept as long as the file is not changed.

    Args:
        reader: what reads it, `module:function`; called with path and words.
        path: the file; one that is not there can be read.
        words: what else the reader takes.

    Raises:
        OSError: no process can be started.
    """
    if in_trial():
        return True
    try:
        state = path.stat()
    except (OSError, ValueError):
        return True  # whoever reads it tells why
    key = (reader, str(path), words, state.st_ino, state.st_size, state.st_mtime_ns)
    seconds = _SECONDS + state.st_size / _BYTES_PER_SECOND
    request = json.dumps([reader, os.path.abspath(path), *words, seconds, _LOADED * seconds]) + "\n"
    with _TRIALS.lock:
        if key not in _TRIALS.known:
            _TRIALS.known[key] = _TRIALS.outcome(request.encode(), seconds)
        return _TRIALS.known[key]


def in_trial() -> bool:
    """Whether this is the process that tries files."""
    return os.environ.get(IN_TRIAL) == str(os.getpid())


IN_TRIAL = "PRISMID_TRIAL_READER"
"""Variable that holds the number of that process."""


def _line(process: subprocess.Popen[bytes], seconds: float) -> bytes:
    """Return what a process says, nothing where it ends before, or says nothing in this time."""
    assert process.stdout is not None
    ready, _, _ = select.select([process.stdout], [], [], seconds)
    return process.stdout.readline() if ready else _GONE
