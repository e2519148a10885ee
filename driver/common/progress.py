"""Where a run tells how it goes: lines that stay, and words that the next ones replace."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from time import monotonic

Log = Callable[[str], None]
"""Takes a line of a log."""
EVERY = 30.0  # s between two lines of a log that tell of one simulation


@dataclass(frozen=True)
class LiveLog:
    """A log of lines that also takes words for the moment.

    Attributes:
        line: takes a line that stays.
        passing: takes what is true for the moment.
    """

    line: Callable[[str], None]
    passing: Callable[[str], None]

    def __call__(self, text: str) -> None:
        """Tell a line that stays."""
        self.line(text)


def passing_of(log: Log) -> Callable[[str], None]:
    """Where words for the moment go; a log of lines alone takes none."""
    return log.passing if isinstance(log, LiveLog) else _no_word


def seldom(
    tell: Callable[[str], None], every: float = EVERY, clock: Callable[[], float] = monotonic
) -> Callable[[str], None]:
    """Tell no more often than every so many seconds, the first time after as many."""
    last = clock()

    def tell_seldom(text: str) -> None:
        nonlocal last
        if clock() - last >= every:
            last = clock()
            tell(text)

    return tell_seldom


def silent(line: str) -> None:
    """Tell nobody: lines of jobs that run side by side would interleave."""


def _no_word(text: str) -> None:
    """Nobody is there to read it."""
