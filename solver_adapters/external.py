"""Solvers outside this process: write the deck, run the program, read its result."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path

from solver_adapters.interface import Capabilities, Response, Simulation


class Status(StrEnum):
    """How a job ended."""

    DONE = "done"
    NOT_CONVERGED = "did not converge"
    OUT_OF_TIME = "out of time"
    OUT_OF_MEMORY = "out of memory"
    COMMAND_MISSING = "command missing"
    KILLED = "killed"
    NO_RESULT = "no result"
    BAD_DECK = "bad deck"


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
        options: further entries that the adapter declares, by name.
    """

    command: tuple[str, ...] = ()
    processes: int = 1
    threads: int = 1
    memory: float = 4000.0
    wall_time: float | None = None
    cpu_time: float | None = None
    options: Mapping[str, str] = field(default_factory=dict)


class ExternalAdapter(ABC):
    """An adapter whose solver is a program of its own.

    A subclass says what it can honour and has three functions, each of which can be tested alone:
    `write` renders the files of a job, `read` understands the files that the program leaves, and
    `diagnose` understands its log.

    Attributes:
        name: word of the case file.
        programs: commands that are looked for on PATH, the best first.
        profile: how the program is called.
    """

    name: str
    programs: tuple[str, ...]

    def __init__(self, profile: Profile | None = None) -> None:
        self.profile = profile or Profile()

    @abstractmethod
    def capabilities(self) -> Capabilities:
        """What this solver can honour."""

    @abstractmethod
    def write(self, simulation: Simulation) -> Mapping[str, bytes]:
        """Files of the job by name: a pure function of simulation and profile."""

    @abstractmethod
    def command(self, program: tuple[str, ...]) -> tuple[str, ...]:
        """The call, made in the folder of the job; `program` as found on this machine."""

    @abstractmethod
    def read(self, simulation: Simulation, folder: Path) -> Response:
        """The response from the files that the program has left in the folder of the job.

        Raises:
            ResultFileError: a file is missing, truncated, empty or not what it should be.
        """

    @abstractmethod
    def diagnose(self, log: str) -> Status:
        """What the log says: DONE where it says nothing of a failure."""
