"""A job that brought no response, told with what helps and what its log says."""

from __future__ import annotations

from solver_adapters.interface import NotRunError, SolverError
from solver_adapters.jobs.status import CACHED, REMEDIES, Status
from solver_adapters.result_files import ResultFileError

LOG_SAYS = "; its log says:"
"""How the first line of an error ends where lines of the log follow."""


class JobError(SolverError):
    """A job that brought no response.

    Attributes:
        adapter: name of the solver adapter.
        status: how it ended.
        detail: what was found, in words, or "".
        remedy: what helps.
        quote: the lines of its log that say why, else its last ones, or "".
        place: where its files are, or "".
    """

    def __init__(
        self,
        adapter: str,
        status: Status,
        detail: str = "",
        quote: str = "",
        place: str = "",
        remedy: str = "",
    ) -> None:
        # All of them, so that it can be sent between processes.
        super().__init__(adapter, status, detail, quote, place, remedy)
        self.adapter, self.status, self.detail = adapter, status, detail
        self.remedy, self.quote, self.place = remedy or REMEDIES[status], quote, place

    def __str__(self) -> str:
        detail = f" ({self.detail})" if self.detail else ""
        said = f"{self.adapter}: {self.status}{detail}; {self.remedy}"
        if self.place:
            said += f"; its files are in {self.place}"
        if self.quote:
            said += LOG_SAYS + "".join(f"\n  | {line}" for line in self.quote.splitlines())
        return said


class CommandMissingError(JobError, NotRunError):
    """The program of a solver is not on this machine, or not where the profile says."""


def is_by_circumstances(error: Exception) -> bool:
    """Whether a failure says nothing of the parameters: not run, killed, out of time, bad deck.

    What was computed without it would hang on the machine and on its load that day.
    """
    if isinstance(error, JobError):
        return error.status not in CACHED
    return isinstance(error, NotRunError | ResultFileError)


def is_out_of_time(error: Exception) -> bool:
    """Whether a run had too little time, which with other parameters might have been enough."""
    return isinstance(error, JobError) and error.status is Status.OUT_OF_TIME
