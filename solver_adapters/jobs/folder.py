"""The folder of a job: written aside and renamed when whole, its record, its log."""

from __future__ import annotations

import json
import os
import shutil
import socket
import tempfile
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import psutil
from pydantic import TypeAdapter, ValidationError

from solver_adapters.jobs.runner import STDERR, STDOUT
from solver_adapters.jobs.status import CACHED, Status
from solver_adapters.result_files import ResultFileError

RECORD, RESPONSE = "job.json", "response.h5"
_TAIL = {STDOUT: 15, STDERR: 5}  # lines
_TAIL_BYTES, _TAIL_WIDTH = 20_000, 200  # of what is read of a log, and of a line that is told
_PROGRESS_BYTES = 400_000  # of the output of a running job; a time step may print 50 000


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


def read_record(folder: Path, statuses: Collection[str]) -> Record | None:
    """Return the record of a job; None where there is no folder.

    Args:
        folder: the folder of the job, named by its key.
        statuses: those that its job can have.

    Raises:
        ResultFileError: the folder has no record that can be read, that of another job, or one
            with a value that cannot be.
    """
    if not folder.is_dir():
        return None
    try:
        text = (folder / RECORD).read_text(encoding="utf-8")
        record = Record(**json.loads(text))
        TypeAdapter(Record).validate_json(text, strict=True)
    except ValidationError as error:
        first = error.errors()[0]
        expected = first["msg"].removeprefix("Input should be ")
        raise _bad_entry(folder, str(first["loc"][0]), first["input"], expected) from None
    except (OSError, ValueError, TypeError) as error:
        # Somebody's results may be in there: it is not for us to remove.
        raise ResultFileError(
            f"{folder / RECORD}: found no record of a job ({error}), expected the one that was "
            "written with it; mend it, or move the folder away"
        ) from None
    if record.key != folder.name:
        raise _bad_entry(folder, "key", record.key, "the name of its folder")
    if record.status not in statuses:
        listed = ", ".join(sorted(f'"{status}"' for status in statuses))
        raise _bad_entry(folder, "status", record.status, f"one of {listed}")
    return record


def _bad_entry(folder: Path, key: str, found: object, expected: str) -> ResultFileError:
    return ResultFileError(
        f"{folder / RECORD}: {key}: found {json.dumps(found)}, expected {expected}; mend it, or "
        "move the folder away"
    )


def put_away(folder: Path) -> Path:
    """Give the folder of a job that cannot be read the next free name KEY.damaged-N."""
    count = 1
    while (aside := folder.with_name(f"{folder.name}.damaged-{count}")).exists():
        count += 1
    folder.rename(aside)
    return aside


def write_aside(jobs: Path, key: str, files: Mapping[str, bytes]) -> Path:
    """Make a folder beside that of the job with its files; others may write theirs meanwhile.

    What processes of this machine that have died left of any job is removed.
    """
    jobs.mkdir(parents=True, exist_ok=True)
    mark = f".partial-{socket.gethostname()}-"
    for left in jobs.glob(f"*{mark}*"):
        process = left.name.partition(mark)[2].partition("-")[0]
        if process.isdecimal() and not psutil.pid_exists(int(process)):
            shutil.rmtree(left, ignore_errors=True)
    folder = Path(tempfile.mkdtemp(prefix=f"{key}{mark}{os.getpid()}-", dir=jobs))
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
    """Return the last lines that a program has printed."""
    lines: list[str] = []
    for name, count in _TAIL.items():
        path = folder / name
        if path.is_file():
            text = _end_of(path, _TAIL_BYTES).expandtabs()
            lines += [line for line in text.splitlines() if line.strip()][-count:]
    return legible(lines)


def end_of_output(folder: Path) -> str:
    """Return the end of what the program of a running job has printed so far."""
    return _end_of(folder / STDOUT, _PROGRESS_BYTES)


def legible(lines: Iterable[str]) -> str:
    """Lines of a log as a person can read them on a terminal."""
    return "\n".join(map(_legible, lines))


def _end_of(path: Path, size: int) -> str:
    """Return the last bytes of a file as text, "" where there is no file yet."""
    try:
        with path.open("rb") as file:
            file.seek(max(path.stat().st_size - size, 0))
            return file.read().decode("utf-8", errors="replace")
    except FileNotFoundError:
        return ""


def _legible(line: str) -> str:
    shown = "".join(sign if sign.isprintable() else "\ufffd" for sign in line.rstrip())
    return shown if len(shown) <= _TAIL_WIDTH else shown[:_TAIL_WIDTH] + " …"
