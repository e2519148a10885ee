"""What `prismid cache list`, `verify` and `prune` find and do in a store of jobs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from rich.table import Table

from driver.case.model import CASE_FILE, load_case
from driver.common.errors import InputError, sentence
from driver.common.formatting import age, byte_size
from driver.results.files import job_store
from solver_adapters.job_store import NO_RECORD, StoredJob, faults_of, remove, stored_jobs

_DAY = 86_400.0  # s
_SHORT = 12  # digits of a key that tell jobs apart


def store_at(path: Path) -> Path:
    """Return the store that is meant: a folder of jobs, or that of a case.

    Args:
        path: a case file, a folder that holds one, or the folder of the jobs.

    Raises:
        InputError: there is no such folder, or the case cannot be used.
    """
    if path.is_dir():
        case = path / CASE_FILE
        return job_store(load_case(case)) if case.is_file() else path
    if not path.exists():
        raise InputError(sentence(path, "FOLDER", "nothing", "a folder of jobs, or a case"))
    return job_store(load_case(path))


def jobs_at(path: Path) -> tuple[Path, list[StoredJob]]:
    """Return the store that is meant, and its jobs, the one that was used last first.

    Raises:
        InputError: it is no folder, or the case cannot be used.
        OSError: it cannot be read.
    """
    store = store_at(path).resolve()
    if store.exists() and not store.is_dir():
        raise InputError(sentence(store, "store", "a file", "a folder of jobs, or nothing yet"))
    return store, stored_jobs(store)


def table_of(jobs: Sequence[StoredJob], now: float) -> Table:
    """Return a table of jobs, one a row.

    Args:
        jobs: the jobs.
        now: the time [s since 1970].
    """
    made = Table(box=None, pad_edge=False)
    for column in ("job", "state", "size", "last used", "solver"):
        made.add_column(column, no_wrap=True, justify="right" if column == "size" else "left")
    made.add_column("asked for by", overflow="fold")
    for job in jobs:
        ago = f"{age(max(0.0, now - job.used))} ago"
        state = f"{job.state} ({job.holder})" if job.holder else job.state
        made.add_row(
            job.key[:_SHORT], state, byte_size(job.size), ago, _printable(job.solver),
            _printable(job.asker),
        )  # fmt: skip
    return made


def total_of(store: Path, jobs: Sequence[StoredJob]) -> str:
    """Return how many jobs there are, in which states, and their size."""
    if not jobs:
        return f"{store}: no jobs"
    states = ", ".join(f"{n} {state}" for state, n in Counter(job.state for job in jobs).items())
    return f"{store}: {_jobs(len(jobs))} ({states}), {byte_size(sum(job.size for job in jobs))}"


def verify(jobs: Iterable[StoredJob], tell: Callable[[str], None]) -> tuple[int, int]:
    """Tell what of the jobs is not as it was written, and return how many are and are not.

    Left-overs and jobs that somebody works on are not looked at.

    Args:
        jobs: the jobs.
        tell: takes a sentence for each fault.
    """
    whole = faulty = 0
    for job in jobs:
        faults = list(faults_of(job))
        for fault in faults:
            tell(fault)
        if faults:
            faulty += 1
        elif not job.holder and not job.is_left_over:
            whole += 1
    return whole, faulty


def verified(store: Path, whole: int, faulty: int) -> str:
    """Return the outcome of `verify` in words."""
    if not faulty:
        return f"{store}: {_jobs(whole)} as written"
    return f"{store}: {_jobs(whole)} as written, {_jobs(faulty)} not"


def to_prune(
    jobs: Sequence[StoredJob], failed: bool, older_than: float | None, now: float
) -> list[StoredJob]:
    """Return the jobs that are to be removed; none that somebody works on or without a record.

    Args:
        jobs: the jobs.
        failed: whether only those that no run takes: failed, unfinished or damaged.
        older_than: only those that were not used for so many days, or None.
        now: the time [s since 1970].

    Raises:
        InputError: neither is asked for.
    """
    if not failed and older_than is None:
        raise InputError("prune: found no choice, expected --failed, --older-than DAYS or both")
    return [
        job
        for job in jobs
        if not job.holder
        and job.state != NO_RECORD
        and (job.is_left_over or not failed)
        and (older_than is None or now - job.used > older_than * _DAY)
    ]


def prune(jobs: Sequence[StoredJob], tell: Callable[[str], None]) -> int:
    """Remove jobs, and return their size [bytes].

    Args:
        jobs: the jobs.
        tell: takes a sentence for each that somebody works on by now, which stays.

    Raises:
        OSError: one cannot be removed.
    """
    freed = 0
    for job in jobs:
        holder = remove(job)
        if holder:
            tell(f"{job.folder}: not removed, {holder} works on it by now")
        else:
            freed += job.size
    return freed


def pruned(jobs: Sequence[StoredJob]) -> str:
    """Return how many jobs are to be removed, and what that frees."""
    return f"{_jobs(len(jobs))}, {byte_size(sum(job.size for job in jobs))}"


def _jobs(count: int) -> str:
    return "1 job" if count == 1 else f"{count} jobs"


def _printable(text: str) -> str:
    """Return a text without what a terminal would not show; brackets are no marks of a style."""
    shown = "".join(sign if sign.isprintable() else "\ufffd" for sign in text)
    return shown.replace("[", r"\[")
