"""All jobs of a folder, whoever asked for them: a list, whether they are whole, removal."""

from __future__ import annotations

import errno
import os
import re
import shutil
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from solver_adapters.jobs.folder import (
    PARTIAL,
    PUT_AWAY,
    RECORD,
    RESPONSE,
    RUNNING,
    Record,
    folder_aside,
    other_files,
    process_lives,
    read_record,
    record_was_edited,
)
from solver_adapters.jobs.key import key_with_deck
from solver_adapters.jobs.lock import at_rest, holder_of
from solver_adapters.jobs.prepared import EXIT_CODE, KEY, PREPARED
from solver_adapters.jobs.runner import STDOUT
from solver_adapters.jobs.status import CACHED, Status
from solver_adapters.response_file import read_provenance, read_response
from solver_adapters.result_files import ResultFileError

UNFINISHED, DAMAGED, NO_RECORD = "unfinished", "damaged", "no record"
"""States of what a process left that died, of what was put away, and of what tells nothing."""
_KEY = re.compile(r"([0-9a-f]{64})(\..+)?")
_ENDS = {f".{status.replace(' ', '-')}": status for status in Status}
_ANY = frozenset({RUNNING, PREPARED, *Status})


@dataclass(frozen=True)
class StoredJob:
    """A job in a folder of its own.

    Attributes:
        folder: the folder.
        key: the key of the job.
        state: a `Status`, "prepared", "running", "unfinished", "damaged" or "no record".
        solver: name of the adapter and identity of the solver, "" where no record tells.
        asker: the case that asked for it first, or "".
        size: of all files [bytes].
        used: when a file of it was written or it was asked for last [s since 1970].
        holder: who works on it, in words, or "".
    """

    folder: Path
    key: str
    state: str
    solver: str
    asker: str
    size: int
    used: float
    holder: str

    @property
    def is_left_over(self) -> bool:
        """Whether no run takes it, and nobody works on it: failed, unfinished or damaged."""
        taken = {RUNNING, PREPARED, NO_RECORD, *CACHED}
        return not self.holder and self.state not in taken


def stored_jobs(store: Path) -> list[StoredJob]:
    """Return the jobs of a folder, the one that was used last first; all else there is left out.

    Args:
        store: the folder of the folders of jobs; one that is not there has none.

    Raises:
        OSError: the folder is none, or cannot be read.
    """
    try:
        paths = sorted(store.iterdir())
    except FileNotFoundError:
        return []
    jobs = [
        _stored_job(path, found[1], found[2] or "")
        for path in paths
        if (found := _KEY.fullmatch(path.name)) and path.is_dir() and not path.is_symlink()
    ]
    return sorted((job for job in jobs if job is not None), key=lambda job: -job.used)


def _stored_job(folder: Path, key: str, ending: str) -> StoredJob | None:
    """Return the job of a folder; None of a folder that is none, or is gone."""
    if ending and ending not in _ENDS and not ending.startswith((PARTIAL, PUT_AWAY)):
        return None
    record, holder = _record_in(folder), holder_of(folder.with_name(key))
    if ending.startswith(PARTIAL):
        if not holder and process_lives(folder):
            holder = "a process of this machine"
        state = RUNNING if holder else UNFINISHED
    elif ending:
        state, holder = _ENDS.get(ending, DAMAGED), ""
    else:
        state = NO_RECORD if record is None else record.status
        if state == PREPARED and not holder and _begun_elsewhere(folder):
            holder = "another machine"
    size, used = _size_and_use(folder)
    if not used:
        return None
    solver = "" if record is None else f"{record.adapter}: {record.solver}"
    asker = "" if record is None else record.asker
    return StoredJob(folder, key, state, solver, asker, size, used, holder)


def _record_in(folder: Path) -> Record | None:
    with suppress(ResultFileError):
        return read_record(folder, _ANY, named=False)
    return None


def _begun_elsewhere(folder: Path) -> bool:
    """Whether a job that was prepared for another machine is being computed."""
    begun = any((folder / name).exists() for name in (STDOUT, KEY))
    return begun and not (folder / EXIT_CODE).exists()


def _size_and_use(folder: Path) -> tuple[int, float]:
    """Return size of all files [bytes], and when one was written last [s]; 0 of what is gone."""
    size, used = 0, 0.0
    for place, _, names in os.walk(folder):
        for name in (".", *names):
            with suppress(OSError):  # a job that is running writes and removes files
                told = os.lstat(os.path.join(place, name))
                used = max(used, told.st_mtime)
                size += told.st_size if name != "." else 0
    return size, used


def faults_of(job: StoredJob) -> Iterator[str]:
    """Tell what of a job is not as it was written, a sentence each.

    The key is that of the deck on disk, each file has its hash of the end of the job, and the
    record its own. Of a job of an earlier version, without hashes, the response is read. Left-overs
    and jobs at work, on which nothing depends, have no faults.

    Args:
        job: the job.
    """
    if job.holder or job.state not in {NO_RECORD, PREPARED, *CACHED}:
        return
    try:
        record = read_record(job.folder, {PREPARED, *CACHED})
    except ResultFileError as error:
        yield str(error)
        return
    if record is None:
        return
    if record.status != PREPARED and record_was_edited(job.folder):
        yield f"{job.folder / RECORD}: found an edited record, expected it as it was written"
    yield from other_files(job.folder, record, record.digests)
    if record.simulation and not _deck_makes_key(job.folder, record):
        yield f"{job.folder}: found a deck of another key, expected one of the key in this name"
    if not record.digests and record.status == Status.DONE:
        yield from _faults_of_response(job)


def _deck_makes_key(folder: Path, record: Record) -> bool:
    """Whether the deck on disk has the key of its job; other ends of lines are the same deck."""
    try:
        files = {name: (folder / name).read_bytes() for name in record.files}
    except OSError:
        return False
    unix = {name: content.replace(b"\r\n", b"\n") for name, content in files.items()}
    return record.key in (key_with_deck(record.simulation, deck) for deck in (files, unix))


def _faults_of_response(job: StoredJob) -> Iterator[str]:
    path = job.folder / RESPONSE
    try:
        read_response(path)
        found = read_provenance(path).key
    except ResultFileError as error:
        yield str(error)
        return
    if found != job.key:
        yield f"{path}: found the response of the job {found}, expected this job's"


def remove(job: StoredJob) -> str:
    """Remove a job, unless somebody works on it by now, and return who does, or "".

    Nobody finds half of it: its folder has the name of one that a process has not filled while its
    files are removed.

    Args:
        job: the job.

    Raises:
        OSError: it cannot be removed.
    """
    folder = job.folder.with_name(job.key)
    with at_rest(folder) as ours:
        if not ours:
            return holder_of(folder) or "another process"
        if PARTIAL in job.folder.name and process_lives(job.folder):
            return "a process of this machine"
        if not job.folder.is_dir():
            return ""  # another one has removed it
        if not os.access(job.folder, os.W_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(job.folder))
        aside = folder_aside(job.folder.parent, job.key)
        os.replace(job.folder, aside)
        shutil.rmtree(aside)
    return ""
