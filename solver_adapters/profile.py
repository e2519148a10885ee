"""How an external program is called on a machine, and where a user says so."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path

from solver_adapters.user_folders import config_folder

CONFIG_VARIABLE = "PRISMID_CONFIG"


@dataclass(frozen=True)
class Profile:
    """How an external program is called on this machine, and what it may use.

    Attributes:
        command: program and leading arguments, or empty for the first of `ExternalAdapter.programs`
            on PATH.
        processes: MPI processes of one job.
        threads: threads of each.
        memory: memory limit of one job [MB].
        wall_time: limit of the wall-clock time [s], or None.
        cpu_time: limit of the CPU time of all processes together [s], or None.
        prepare_only: jobs are written for another machine instead of being run.
        asker: who asks for the jobs, for their records; no part of how a program is called.
    """

    command: tuple[str, ...] = ()
    processes: int = 1
    threads: int = 1
    memory: float = 4000.0
    wall_time: float | None = None
    cpu_time: float | None = None
    prepare_only: bool = False
    asker: str = field(default="", compare=False)


def config_path() -> Path:
    """Return the user's configuration, for all cases: PRISMID_CONFIG or prismid/config.toml."""
    stated = os.environ.get(CONFIG_VARIABLE)
    return Path(stated) if stated else config_folder() / "config.toml"
