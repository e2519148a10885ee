"""A job that brought no response: what failed, in the words of its user."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from solver_adapters.jobs.errors import CommandMissingError, JobError
from solver_adapters.jobs.folder import legible, tail_of
from solver_adapters.jobs.prepared import EXIT_CODE
from solver_adapters.jobs.runner import Ended
from solver_adapters.jobs.status import Status
from solver_adapters.profile import Profile, config_path

PASSING = "prismid-"
"""How the folder of jobs that are not kept begins."""


@dataclass(frozen=True)
class Failure:
    """How a job failed.

    Attributes:
        status: what happened.
        detail: what was found, in words, or "".
    """

    status: Status
    detail: str


def limit_told(ended: Ended, profile: Profile) -> str:
    """Why the system ended a program: the limit of the profile that it met, or its exit code."""
    if ended.limit == "memory":
        return f"{_number(ended.memory)} MB, the limit is {_number(profile.memory)} MB"
    if ended.limit == "wall_time":
        return f"limit of the wall-clock time {profile.wall_time:g} s"
    if ended.limit == "cpu_time":
        return f"limit of the CPU time {profile.cpu_time:g} s"
    return f"exit code {ended.code}"


def failed(adapter: str, failure: Failure, folder: Path, cause: str, remedy: str = "") -> JobError:
    """Return error of a job, with what its log says and the place of its files if they are kept.

    Args:
        adapter: name of the solver.
        failure: how the job failed.
        folder: its folder.
        cause: the lines of its log that say why, or "" for its last ones.
        remedy: what helps, or "" for what helps with the status.
    """
    kept = "" if folder.parent.name.startswith(PASSING) else str(folder)
    kind = CommandMissingError if failure.status is Status.COMMAND_MISSING else JobError
    quote = legible(cause.splitlines()) if cause else tail_of(folder)
    return kind(adapter, failure.status, failure.detail, quote, kept, remedy)


def missing(
    adapter: str, programs: Sequence[str], profile: Profile, waiting: str
) -> CommandMissingError:
    """Return error of a program that is absent: what to put where, or whose results are awaited.

    Args:
        adapter: name of the solver.
        programs: commands that were looked for, unless the profile states one.
        profile: how the program is called.
        waiting: folder of the job that was prepared for another machine, or "".
    """
    stated = profile.command
    looked = f'"{stated[0]}"' if stated else " or ".join(f'"{name}"' for name in programs)
    where = "" if stated and "/" in stated[0] else " on PATH"
    example = f'command = ["/path/to/{programs[0]}"]'
    remedy = (
        f"install it, or state the call as {example} under [solver.profiles.{adapter}] in "
        f"the case or under [profiles.{adapter}] in {config_path()}, or let "
        "`prismid run --prepare-only` write the jobs for another machine"
    )
    if waiting:
        remedy += (
            f"; the job prepared in {waiting} has no results yet (the last of its files is "
            f"{EXIT_CODE})"
        )
    detail = f"found no {looked}{where}"
    return CommandMissingError(adapter, Status.COMMAND_MISSING, detail, remedy=remedy)


def _number(value: float) -> str:
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"
