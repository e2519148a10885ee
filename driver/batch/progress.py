"""How far the jobs of a campaign are: read from their logs, told as a table or in lines."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass

from rich.table import Table

from driver.batch.jobs import Job
from driver.common.formatting import duration

_STARTED = re.compile(r"^\s*[\d.]+ s  (\w+): started$", re.MULTILINE)
_SECONDS = re.compile(r"^\s*([\d.]+) s", re.MULTILINE)
_TIME = re.compile(r"^\s*[\d.]+ s\s+")
_TAIL = 4096  # bytes of a log that are read
_CLOCKS = 2.0  # s by which clocks of two machines may differ
_WIDE = 60  # characters of the last line
_SHOWN = 30  # jobs of a table; of more those that wait or have ended are left out


@dataclass(frozen=True)
class State:
    """How far a job is.

    Attributes:
        job: the job.
        status: "waiting", "running", or as of `Outcome`.
        seconds: since it began.
        stage: which it is at.
        words: the last line of its log, or why it failed.
    """

    job: Job
    status: str
    seconds: float = 0.0
    stage: str = ""
    words: str = ""

    @property
    def left(self) -> float:
        """Seconds that it will still take by its estimate; half as long again once that is over."""
        if self.status == "waiting":
            return self.job.cost.seconds
        if self.status != "running":
            return 0.0
        return max(self.job.cost.seconds - self.seconds, 0.5 * self.seconds)


def at_work(job: Job, since: float) -> State:
    """Return the state of a job that has not ended, by its log: on a cluster nothing else tells it.

    Args:
        job: the job.
        since: when the campaign began; a log of before is of another run [s since the epoch].
    """
    try:
        with job.log.open("rb") as file:
            about = os.fstat(file.fileno())
            file.seek(max(0, about.st_size - _TAIL))
            text = file.read().decode("utf-8", errors="replace")
    except FileNotFoundError:
        return State(job, "waiting")
    if about.st_mtime < since - _CLOCKS:
        return State(job, "waiting")
    stages, lines = _STARTED.findall(text), text.splitlines()
    words = _TIME.sub("", lines[-1]) if lines else ""
    times = _SECONDS.findall(text)
    seconds = float(times[-1]) if times else 0.0
    return State(job, "running", seconds, stages[-1] if stages else "", words)


def remaining(states: Sequence[State], at_a_time: int) -> float:
    """Seconds until all jobs are done.

    Args:
        states: of all jobs.
        at_a_time: how many run side by side.
    """
    left = [state.left for state in states]
    return max(sum(left) / at_a_time, max(left, default=0.0))


def table(states: Sequence[State], at_a_time: int) -> Table:
    """Return the table that stands on a terminal.

    Args:
        states: of all jobs.
        at_a_time: how many run side by side.
    """
    count = {status: sum(s.status == status for s in states) for status in _ORDER}
    told = ", ".join(f"{number} {status}" for status, number in count.items() if number)
    made = Table(title=f"{told}; about {duration(remaining(states, at_a_time))} left")
    for column in ("case", "state", "stage", "time", "left", "last line"):
        made.add_column(column, no_wrap=True)
    for state in sorted(states, key=lambda s: _ORDER.index(s.status))[:_SHOWN]:
        left = duration(state.left) if state.left else ""
        time = duration(state.seconds) if state.seconds else ""
        words = state.words.partition("\n")[0]
        words = words if len(words) <= _WIDE else words[: _WIDE - 1] + "…"
        made.add_row(state.job.name, state.status, state.stage, time, left, words)
    if len(states) > _SHOWN:
        made.caption = f"{len(states) - _SHOWN} more"
    return made


_ORDER = ("running", "failed", "stopped", "waiting", "done")
