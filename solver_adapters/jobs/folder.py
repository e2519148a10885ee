"""The folder of a job: written aside and renamed when whole, its record, its log."""

from __future__ import annotations

import json
import os
import shutil
import socket
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import psutil

from solver_adapters.jobs.runner import STDERR, STDOUT
from solver_adapters.jobs.status import CACHED, Status
from solver_adapters.result_files import ResultFileError

RECORD, RESPONSE = "job.json", "response.h5"
_TAIL = {STDOUT: 15, STDERR: 5}  # lines


@dataclass(frozen=True)
class Record:
    """What `job.json` says of a job.

    Attributes:
        adapter: name of the solver adapter.
        key: key of the job.
        solver: identity of the solver.
        status: a `Status`, or "prepared".
        detail: what went wrong, in words, or "".
        command: the call.
        code: exit code.
        wall: wall-clock time [s].
        cpu: CPU time [s].
        memory: most resident memory [MB].
        files: names of the files that prismid wrote.
    """

    adapter: str
    key: str
    solver: str
    status: str
    detail: str = ""
    command: Sequence[str] = ()
    code: int = 0
    wall: float = 0.0
    cpu: float = 0.0
    memory: float = 0.0
    files: Sequence[str] = ()


def write_record(folder: Path, record: Record) -> None:
    """Write the record of a job."""
    text = json.dumps(asdict(record), indent=1, ensure_ascii=False)
    (folder / RECORD).write_text(text + "\n", encoding="utf-8")


def read_record(folder: Path) -> Record | None:
    """The record of a job; None where there is no folder.

    Raises:
        ResultFileError: the folder has no record that can be read.
    """
    if not folder.is_dir():
        return None
    try:
        return Record(**json.loads((folder / RECORD).read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError) as error:
        # Somebody's results may be in there: it is not for us to remove.
        raise ResultFileError(
            f"{folder / RECORD}: found no record of a job ({error}), expected the one that was "
            "written with it; mend it, or move the folder away"
        ) from None


def write_aside(jobs: Path, key: str, files: Mapping[str, bytes]) -> Path:
    """A folder beside that of the job, in which its files are; others may write theirs meanwhile.

    What processes that have died left of the same job is removed.
    """
    jobs.mkdir(parents=True, exist_ok=True)
    prefix = f"{key}.partial-{socket.gethostname()}-"
    for left in jobs.glob(f"{prefix}*"):
        if not psutil.pid_exists(int(left.name.removeprefix(prefix).split("-")[0])):
            shutil.rmtree(left, ignore_errors=True)
    folder = Path(tempfile.mkdtemp(prefix=f"{prefix}{os.getpid()}-", dir=jobs))
    folder.chmod(0o755)
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    return folder


def settle(partial: Path, jobs: Path, key: str, status: Status = Status.DONE) -> Path:
    """Give a whole folder its name: the key, with the status where that is not to be kept.

    If another process has run the same job meanwhile, its folder stays and this one goes.
    """
    folder = jobs / key
    if status not in CACHED:
        folder = jobs / f"{key}.{status.replace(' ', '-')}"
        shutil.rmtree(folder, ignore_errors=True)
    try:
        partial.rename(folder)
    except OSError:
        if not folder.is_dir():
            raise
        shutil.rmtree(partial)
    return folder


def log_of(folder: Path) -> str:
    """All that a program has printed."""
    texts = [
        (folder / name).read_text(encoding="utf-8", errors="replace")
        for name in (STDOUT, STDERR)
        if (folder / name).is_file()
    ]
    return "\n".join(texts)


def tail_of(folder: Path) -> str:
    """The last lines that a program has printed."""
    lines: list[str] = []
    for name, count in _TAIL.items():
        if (folder / name).is_file():
            text = (folder / name).read_text(encoding="utf-8", errors="replace")
            lines += [line.rstrip() for line in text.splitlines() if line.strip()][-count:]
    return "\n".join(lines)
