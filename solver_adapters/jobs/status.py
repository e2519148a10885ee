"""How a job ended, and what helps."""

from __future__ import annotations

from enum import StrEnum


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


CACHED = frozenset({Status.DONE, Status.NOT_CONVERGED, Status.BAD_DECK})
"""Ends that a repetition would only repeat: they do not depend on the load of the machine."""

REMEDIES = {
    Status.NOT_CONVERGED: "smaller steps may help: raise steps_per_interval in [solver]",
    Status.OUT_OF_TIME: "raise wall_time_s or cpu_time_s in the profile of the solver",
    Status.OUT_OF_MEMORY: "raise memory_MB in the profile of the solver, or take a coarser mesh",
    Status.COMMAND_MISSING: "state the command in the profile of the solver",
    Status.KILLED: "it was ended from outside, by a person, a queue or a machine short of memory; "
    "run again",
    Status.NO_RESULT: "its log may say why; a full disk or another version of the program do it",
    Status.BAD_DECK: "the program cannot read or use what prismid wrote: see its log, and whether "
    "its version is one that the adapter knows",
}
"""What helps, for each end but DONE."""
