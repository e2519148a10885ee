"""How a job ended, and what helps."""

from __future__ import annotations

from enum import StrEnum


class Status(StrEnum):
    """How a job ended."""

    DONE = "done"
    NOT_CONVERGED = "did not converge"
    OUT_OF_TIME = "out of time"
    OUT_OF_MEMORY = "out of memory"
    OUT_OF_DISK = "out of disk"
    COMMAND_MISSING = "command missing"
    BROKEN = "broken installation"
    CRASHED = "crashed"
    KILLED = "killed"
    NO_RESULT = "no result"
    BAD_DECK = "bad deck"


CACHED = frozenset({Status.DONE, Status.NOT_CONVERGED})
"""Ends that say something of the parameters, and that a repetition would only repeat."""

REMEDIES = {
    Status.NOT_CONVERGED: "smaller steps may help: raise steps_per_interval in [solver]",
    Status.OUT_OF_TIME: "raise wall_time_s or cpu_time_s in the profile of the solver",
    Status.OUT_OF_MEMORY: "raise memory_MB in the profile of the solver, or take a coarser mesh",
    Status.OUT_OF_DISK: "free space where the jobs are (execution.store of the case, else "
    "results/jobs beside it), and run again",
    Status.COMMAND_MISSING: "state the command in the profile of the solver",
    Status.BROKEN: "the program cannot start where it is installed: mend it (its libraries, its "
    "environment), or state another call in the profile of the solver",
    Status.CRASHED: "the fault is in the program or its libraries: run again; where it repeats, "
    "`ulimit -s unlimited` before the run, another build or more memory may help",
    Status.KILLED: "it was ended from outside, by a person, a queue or a machine short of memory; "
    "run again",
    Status.NO_RESULT: "its log may say why; a full disk or another version of the program do it",
    Status.BAD_DECK: "the program cannot read or use what prismid wrote: see its log, and whether "
    "its version is one that the adapter knows",
}
"""What helps, for each end but DONE."""
