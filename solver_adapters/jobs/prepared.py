"""Jobs for another machine: written whole with how to run them, collected when they come back."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from pathlib import Path

from solver_adapters.jobs.folder import (
    RECORD,
    Record,
    read_record,
    settle,
    write_aside,
    write_record,
)
from solver_adapters.jobs.runner import STDERR, STDOUT

PREPARED = "prepared"
ELSEWHERE = "elsewhere"
"""The identity under which the key of a prepared job is made: nobody knows yet where it runs."""

README, SCRIPT, EXIT_CODE = "README.txt", "run.sh", "exit_code.txt"


def prepare(
    jobs: Path,
    record: Record,
    files: Mapping[str, bytes],
    environment: Mapping[str, str],
) -> Path:
    """Write the complete folder of a job that runs on another machine.

    Args:
        jobs: the folder of all jobs.
        record: adapter, key and command of the job.
        files: its files by name.
        environment: variables that its program needs.
    """
    settings = "".join(f"export {name}={shlex.quote(v)}\n" for name, v in environment.items())
    call = shlex.join(record.command)
    script = (
        '#!/bin/sh\ncd "$(dirname "$0")" || exit 1\n'
        f"rm -f {EXIT_CODE}\n{settings}{call} > {STDOUT} 2> {STDERR} < /dev/null\n"
        f"echo $? > {EXIT_CODE}\n"
    )
    texts = {README: _readme(record, call), SCRIPT: script}
    everything = {**files, **{name: text.encode() for name, text in texts.items()}}
    partial = write_aside(jobs, record.key, everything)
    write_record(partial, record)
    return settle(partial, jobs, record.key)


def prepared_job(folder: Path) -> Record | None:
    """The record of a folder that `prepare` has written; None of any other."""
    record = read_record(folder)
    return record if record is not None and record.status == PREPARED else None


def has_results(folder: Path, record: Record) -> bool:
    """Whether a prepared job has more files than were written, and its script has ended."""
    if (folder / STDOUT).is_file() and not (folder / EXIT_CODE).is_file():
        return False
    own = {*record.files, README, SCRIPT, RECORD}
    return any(
        path.is_file() and str(path.relative_to(folder)) not in own for path in folder.rglob("*")
    )


def exit_code(folder: Path) -> int:
    """The exit code that the script of a prepared job has left, 0 if none."""
    try:
        return int((folder / EXIT_CODE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return 0


def _readme(record: Record, call: str) -> str:
    return f"""\
A job of prismid for the solver {record.adapter}, to be computed on any machine that has it.

1. Copy this folder there, whole.
2. Run in it:      sh {SCRIPT}
   which calls:    {call}
   Edit the call if the program has another name there; leave the other files as they are.
3. Copy the folder back, with all files that the program has left, to where it was:
   results/jobs/{record.key}
4. `prismid run` on the case reads the results and goes on. It may then ask for further jobs,
   for a fit decides by the results of one simulation what to simulate next.

"solver" in {RECORD} may be set to the name and version of the program that was used; results
then carry it. Nothing else depends on it.
"""
