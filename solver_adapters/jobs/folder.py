"""The folder of a job: written aside and renamed when whole, its record, its log."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from secrets import token_hex
from typing import Any

import psutil
from pydantic import TypeAdapter, ValidationError

from solver_adapters.jobs.machine import SPACE, this_machine
from solver_adapters.jobs.runner import STDERR, STDOUT
from solver_adapters.jobs.status import CACHED, Status
from solver_adapters.result_files import ResultFileError

RECORD, RESPONSE = "job.json", "response.h5"
RUNNING = "running"
"""The status of a job in a folder that is not whole yet."""
PARTIAL, PUT_AWAY = ".partial-", ".damaged-"
"""What follows the key in the name of such a folder, and in that of one beyond repair."""
_CHECKSUM = "checksum"
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
        status: a `Status`, or "prepared", or "running".
        detail: what went wrong, in words, or "".
        command: the call.
        code: exit code.
        wall: wall-clock time [s].
        cpu: CPU time [s].
        memory: most resident memory [MB].
        files: names of the files that prismid wrote.
        simulation: hash of simulation, adapter and solver, which makes the key with these files.
        asker: the case that asked for it first, or "".
        digests: SHA-256 of each file of a job that has ended, by its name; none of a job of an
            earlier version.
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
    simulation: str = ""
    asker: str = ""
    digests: Mapping[str, str] = field(default_factory=dict)


_ENTRIES = frozenset(item.name for item in fields(Record))


def write_record(folder: Path, record: Record) -> None:
    """Write the record of a job, with a checksum of its own; whole, or not at all."""
    entries = asdict(record)
    text = json.dumps(entries | {_CHECKSUM: _checksum(entries)}, indent=1, ensure_ascii=False)
    whole = folder / f"{RECORD}.partial"
    whole.write_text(text + "\n", encoding="utf-8")
    whole.replace(folder / RECORD)


def write_ended(folder: Path, record: Record) -> None:
    """Write the record of a job that has ended, with the hashes of all files in its folder."""
    names = (str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())
    digests = {name: digest_of(folder / name) for name in sorted(names) if name != RECORD}
    write_record(folder, replace(record, digests=digests))


def digest_of(path: Path) -> str:
    """SHA-256 of the content of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def record_was_edited(folder: Path) -> bool:
    """Whether a record, which can be read, is not as it was written."""
    entries = json.loads((folder / RECORD).read_text(encoding="utf-8"))
    stated = entries.pop(_CHECKSUM, None)
    return stated is not None and stated != _checksum(entries)


def _checksum(entries: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(entries, sort_keys=True).encode()).hexdigest()


def other_files(folder: Path, record: Record, names: Iterable[str]) -> Iterator[str]:
    """Tell which files of a job that has ended are not as they were then, a sentence each.

    Args:
        folder: the folder of the job.
        record: its record.
        names: the files; one without a hash in the record may be anything.
    """
    for name in names:
        if name not in record.digests:
            continue
        path, expected = folder / name, "expected the one that was there as its job ended"
        try:
            if digest_of(path) != record.digests[name]:
                yield f"{path}: found a file of another content, {expected}"
        except OSError as error:
            yield f"{path}: {error.strerror}, {expected}"


def refuse_other_files(folder: Path, record: Record, names: Iterable[str]) -> None:
    """Raise where a file of a job that has ended is not as it was then, see `other_files`.

    Raises:
        ResultFileError: the first of them.
    """
    for told in other_files(folder, record, names):
        raise ResultFileError(told)


def note_use(folder: Path) -> None:
    """Let the record tell by its time when the job was used last."""
    with suppress(OSError):  # a store that can only be read
        os.utime(folder / RECORD)


def read_record(folder: Path, statuses: Collection[str], named: bool = True) -> Record | None:
    """Return the record of a job; None where there is no folder.

    Args:
        folder: the folder of the job, named by its key.
        statuses: those that its job can have.
        named: whether the folder has the name of its job, and not of one that has failed.

    Raises:
        ResultFileError: the folder has no record that can be read, that of another job, or one
            with a value that cannot be.
    """
    if not folder.is_dir():
        return None
    try:
        text = (folder / RECORD).read_text(encoding="utf-8")
        # Another version of prismid that works on the same store may have written more.
        record = Record(**{k: v for k, v in dict(json.loads(text)).items() if k in _ENTRIES})
        TypeAdapter(Record).validate_json(text, strict=True)
    except ValidationError as error:
        first = error.errors()[0]
        expected = first["msg"].removeprefix("Input should be ")
        raise _bad_entry(folder, str(first["loc"][0]), first["input"], expected) from None
    except (OSError, ValueError, TypeError) as error:
        if not folder.is_dir():
            return None  # another process has put it away or removed it
        # Somebody's results may be in there: it is not for us to remove.
        raise ResultFileError(
            f"{folder / RECORD}: found no record of a job ({error}), expected the one that was "
            "written with it; mend it, or move the folder away"
        ) from None
    if named and record.key != folder.name:
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
    while (aside := folder.with_name(f"{folder.name}{PUT_AWAY}{count}")).exists():
        count += 1
    folder.rename(aside)
    return aside


def partial_mark() -> str:
    """Return what follows the key in the names of folders that processes of this machine fill."""
    return f"{PARTIAL}{this_machine().replace(SPACE, '+')}-"


def process_lives(folder: Path) -> bool | None:
    """Whether the process that fills a folder lives; None where it is on another machine."""
    process = folder.name.partition(partial_mark())[2].partition("-")[0]
    return psutil.pid_exists(int(process)) if process.isdecimal() else None


def folder_aside(jobs: Path, key: str) -> Path:
    """Make a folder beside that of a job, which belongs to this process until it has its name."""
    folder = jobs / f"{key}{partial_mark()}{os.getpid()}-{token_hex(4)}"
    folder.mkdir()
    return folder


def write_aside(jobs: Path, key: str, files: Mapping[str, bytes]) -> Path:
    """Make a folder beside that of the job with its files; others may write theirs meanwhile.

    What processes of this machine that have died left of any job is removed.
    """
    jobs.mkdir(parents=True, exist_ok=True)
    for left in jobs.glob(f"*{partial_mark()}*"):
        if process_lives(left) is False:
            shutil.rmtree(left, ignore_errors=True)
    folder = folder_aside(jobs, key)
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
