"""The queue system whose jobs are the workers of a campaign: its keys, and the user's profiles."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from driver.case.toml import read_tables
from driver.case.values import FileName, Positive, Table
from driver.common.errors import InputError, one_of, sentence
from solver_adapters.user_folders import config_folder

# In a line of a job script, or alone in one.
Word = Annotated[str, Field(pattern=r"^[^\s\"'`$\\;&|<>]+$")]
Line = Annotated[str, Field(pattern=r"^[^\n\r]+$")]
# Slurm and PBS would take two numbers for minutes and seconds, LSF for hours and minutes.
Walltime = Annotated[str, Field(pattern=r"^\d+:[0-5]\d:[0-5]\d$")]

REQUIRED = ("system", "walltime")


class Queue(Table):
    """What a queue system is asked for; each job of it is one worker, which does a case at a time.

    Names are those of dask-jobqueue.
    """

    system: Literal["slurm", "pbs", "lsf"] | None = Field(
        default=None, description='"slurm", "pbs" or "lsf", the queue system'
    )
    queue: Word | None = Field(
        default=None, description="a word in quotes, the queue, in Slurm the partition"
    )
    account: Word | None = Field(
        default=None, description="a word in quotes, the account, in LSF the project"
    )
    walltime: Walltime | None = Field(
        default=None,
        description='hours:minutes:seconds in quotes, as "24:00:00", the longest time of a worker',
    )
    memory_GB: Positive | None = Field(
        default=None, description="memory of each worker, default as the largest case is estimated"
    )
    interface: Word | None = Field(
        default=None,
        description="a word in quotes, the network over which workers reach this machine",
    )
    job_extra_directives: tuple[Line, ...] | None = Field(
        default=None,
        description="a list of further directives, one line each and without its prefix, "
        'as ["--qos=long"]',
    )
    job_script_prologue: tuple[Line, ...] | None = Field(
        default=None,
        description="a list of commands before each worker, one line each, "
        'as ["module load calculix"]',
    )

    @property
    def seconds(self) -> float:
        """The walltime [s]."""
        hours, minutes, seconds = map(int, (self.walltime or "0:0:0").split(":"))
        return 3600.0 * hours + 60.0 * minutes + seconds


class Cluster(Queue):
    """The table [cluster] of a campaign."""

    profile: FileName | None = Field(
        default=None, description="a text in quotes, the profile for all keys that are not here"
    )


class Profiles(Table):
    """The user's queue systems, for all campaigns."""

    profiles: dict[str, Queue] = Field(
        default_factory=dict, description="tables [profiles.NAME], keys of a queue system each"
    )


def profiles_path() -> Path:
    """Return the file of the user's queue systems."""
    return config_folder() / "clusters.toml"


def queue_of(cluster: Cluster, file: Path) -> Queue:
    """Return what the campaign says of its queue system, over what its profile says.

    Args:
        cluster: the table of the campaign.
        file: of the campaign, to be told.

    Raises:
        InputError: there is no such profile, or it cannot be used; or a key is missing in both.
    """
    entries = cluster.model_dump(exclude_none=True, exclude={"profile"})
    name, path = cluster.profile, profiles_path()
    if name is not None:
        known = read_tables(path, Profiles, f"the file of the profile {name}").profiles
        if name not in known:
            expected = f"{one_of(name, sorted(known))} of {path}" if known else f"one of {path}"
            raise InputError(sentence(file, "cluster.profile", f'"{name}"', expected))
        entries = known[name].model_dump(exclude_none=True) | entries
    missing = [
        sentence(file, f"cluster.{key}", "nothing", Queue.model_fields[key].description or "")
        for key in REQUIRED
        if key not in entries
    ]
    if missing:
        raise InputError("\n".join(missing))
    return Queue.model_validate(entries)
