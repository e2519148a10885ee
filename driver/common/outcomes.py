"""Work that may fail for reasons of its parameters: the failure is an answer, and told in words."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

from driver.common.errors import InputError
from solver_adapters.interface import SolverError
from solver_adapters.jobs.errors import LOG_SAYS, is_by_circumstances

Result = TypeVar("Result")


@dataclass(frozen=True)
class Failure:
    """Why there is no result.

    Attributes:
        why: the first line of what was said.
    """

    why: str


def attempt(work: Callable[[], Result]) -> Result | Failure:
    """Return what work makes, or why it makes nothing: a failed simulation, an input refused.

    A fault of the program is no such answer, and is raised: it would hide here.

    Raises:
        NotRunError: a simulation was not run.
        JobError, ResultFileError: one was killed, ran out of time or left no result: that says
            nothing of the parameters.
    """
    try:
        return work()
    except (SolverError, InputError) as error:
        if is_by_circumstances(error):
            raise
        return Failure(first_line(error))


def first_line(error: Exception) -> str:
    """Return the first line of what was said; others hold the end of a log."""
    return str(error).partition("\n")[0].removesuffix(LOG_SAYS)
