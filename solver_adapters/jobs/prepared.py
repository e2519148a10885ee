"""Jobs for another machine: written whole with how to run them, collected when they come back."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from solver_adapters.jobs.answer import refuse_other_deck
from solver_adapters.jobs.folder import (
    RECORD,
    Record,
    read_record,
    settle,
    write_aside,
    write_record,
)
from solver_adapters.jobs.runner import STDERR, STDOUT
from solver_adapters.jobs.status import Status
from solver_adapters.result_files import ResultFileError

PREPARED = "prepared"
ELSEWHERE = "elsewhere"
"""The identity under which the key of a prepared job is made: nobody knows yet where it runs."""

FROM_ELSEWHERE = frozenset({PREPARED, Status.DONE})
"""Statuses that such a job can have."""

README, SCRIPT, EXIT_CODE, KEY = "README.txt", "run.sh", "exit_code.txt", "key.txt"


def prepare(
    jobs: Path,
    record: Record,
    files: Mapping[str, bytes],
    environment: Mapping[str, str],
    scratch: Sequence[str] = (),
) -> Path:
    """Write the complete folder of a job that runs on another machine.

    Args:
        jobs: the folder of all jobs.
        record: adapter, key and command of the job.
        files: its files by name.
        environment: variables that its program needs.
        scratch: folders of the job that nobody needs once it has ended.
    """
    texts = _texts(jobs / record.key, record, environment, scratch)
    everything = {**files, **{name: text.encode() for name, text in texts.items()}}
    partial = write_aside(jobs, record.key, everything)
    write_record(partial, record)
    return settle(partial, jobs, record.key)


def refresh(
    folder: Path,
    waiting: Record,
    record: Record,
    files: Mapping[str, bytes],
    environment: Mapping[str, str],
    scratch: Sequence[str] = (),
) -> None:
    """Give a prepared job the limits and the call that are stated now.

    A job that has begun is left alone, and its script, which somebody may have edited, where the
    call is the same.

    Args:
        folder: the folder of the job.
        waiting: its record.
        record: the record that it would get now.
        files: as in `prepare`.
        environment: as there.
        scratch: as there.

    Raises:
        ResultFileError: a file of the deck is missing or was changed.
    """
    if (folder / STDOUT).exists() or (folder / KEY).exists():
        return
    refuse_other_deck(folder, files)
    texts = {name: content for name, content in files.items() if b"\0" not in content}
    if tuple(waiting.command) != tuple(record.command):
        of_call = _texts(folder, record, environment, scratch)
        texts |= {name: text.encode() for name, text in of_call.items()}
        write_record(folder, record)
    for name, content in texts.items():
        if (folder / name).read_bytes() != content:
            whole = folder / f"{name}.partial"
            whole.write_bytes(content)
            whole.replace(folder / name)


def _texts(
    folder: Path, record: Record, environment: Mapping[str, str], scratch: Sequence[str]
) -> dict[str, str]:
    """How a job is run, by the name of the file: the script, and what a person does."""
    settings = "".join(f"export {name}={shlex.quote(v)}\n" for name, v in environment.items())
    call = shlex.join(record.command)
    left = f"rm -rf {shlex.join(scratch)}\n" if scratch else ""
    script = (
        '#!/bin/sh\ncd "$(dirname "$0")" || exit 1\n'
        f"rm -f {EXIT_CODE}\necho {record.key} > {KEY}\n"
        f"{settings}{call} > {STDOUT} 2> {STDERR} < /dev/null\n"
        f"code=$?\n{left}echo $code > {EXIT_CODE}\n"
    )
    return {README: _readme(folder, record, call), SCRIPT: script}


def prepared_job(folder: Path) -> Record | None:
    """Return the record of a folder that `prepare` has written; None of any other."""
    record = read_record(folder, FROM_ELSEWHERE)
    return record if record is not None and record.status == PREPARED else None


def has_results(folder: Path, results: Iterable[str]) -> bool:
    """Whether a prepared job was computed: its script has ended, or left one of these files.

    Other files (of a queue, of an editor) say nothing, and a log without an exit code says that
    the script has not ended.
    """
    if (folder / EXIT_CODE).exists():
        return True
    return not (folder / STDOUT).exists() and any((folder / name).exists() for name in results)


def refuse_other_job(folder: Path) -> None:
    """Raise where the results in the folder of a job were computed in that of another.

    Raises:
        ResultFileError: the script of another job has left its key.
    """
    path = folder / KEY
    if path.exists():
        found = _word(path, "the key of the job")
        if found != folder.name:
            raise ResultFileError(
                f"{path}: found results of the job {found[:64]}, expected those of {folder.name}"
            )


def exit_code(folder: Path) -> int:
    """Return the exit code that the script of a prepared job has left, 0 if none.

    Raises:
        ResultFileError: there is a file, but no exit code in it.
    """
    path = folder / EXIT_CODE
    if not path.exists():
        return 0
    expected = f"the exit code that {SCRIPT} writes"
    found = _word(path, expected)
    if not found.isdecimal():
        raise ResultFileError(f"{path}: found {found[:20]!r}, expected {expected}")
    return int(found)


def _word(path: Path, expected: str) -> str:
    try:
        return path.read_text(encoding="ascii", errors="replace").strip()
    except OSError as error:
        raise ResultFileError(f"{path}: {error.strerror}, expected {expected}") from None


def _readme(folder: Path, record: Record, call: str) -> str:
    return f"""\
A job of prismid for the solver {record.adapter}, to be computed on any machine that has it.

1. Copy this folder there, whole.
2. Run in it:      sh {SCRIPT}
   which calls:    {call}
   Edit the call if the program has another name there; leave the other files as they are.
3. Copy the folder back, with all files that the program has left, to where it was:
   {folder.absolute()}
4. `prismid run` on the case reads the results and goes on. It may then ask for further jobs,
   for a fit decides by the results of one simulation what to simulate next.

"solver" in {RECORD} may be set to the name and version of the program that was used; results
then carry it. Nothing else depends on it.
"""
