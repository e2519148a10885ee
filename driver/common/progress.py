"""How a run tells its progress: records of the standard `logging` under the logger `driver`.

A line that stays is of the level INFO, words that the next ones replace are of the level PASSING.
"""

from __future__ import annotations

import logging
import math
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from time import monotonic

from driver.common.formatting import duration
from solver_adapters.interface import Progress

logger = logging.getLogger(__name__)

LOGGER = "driver"
"""Name of the logger above those of all modules of the driver."""
PASSING = 15
"""Level of words for the moment, between those of `logging.DEBUG` and `logging.INFO`."""
EVERY = 30.0  # s between two lines of a log that tell of one simulation


class ProgressHandler(logging.Handler):
    """A handler that hands lines that stay and words for the moment to a function each.

    Args:
        line: takes a line that stays.
        passing: takes words for the moment.
    """

    def __init__(self, line: Callable[[str], None], passing: Callable[[str], None]) -> None:
        super().__init__(PASSING)
        self.line, self.passing = line, passing

    def emit(self, record: logging.LogRecord) -> None:
        """Hand over the message of a record."""
        (self.passing if record.levelno == PASSING else self.line)(record.getMessage())


def _no_word(text: str) -> None:
    """Nobody is there to read it."""


@contextmanager
def progress_to(
    line: Callable[[str], None], passing: Callable[[str], None] = _no_word
) -> Iterator[None]:
    """Hand all that the driver tells inside to a function for each kind.

    Args:
        line: takes a line that stays.
        passing: takes words for the moment.
    """
    driver, handler = logging.getLogger(LOGGER), ProgressHandler(line, passing)
    with _heard_alone(driver):
        driver.addHandler(handler)
        try:
            yield
        finally:
            driver.removeHandler(handler)


class _Onward(logging.Handler):
    """Hands on to the handlers above a logger what they were handed before."""

    def __init__(self, logger: logging.Logger) -> None:
        super().__init__(logger.getEffectiveLevel())
        self.above = logger.parent

    def emit(self, record: logging.LogRecord) -> None:
        """Hand on a record."""
        if self.above is not None:
            self.above.callHandlers(record)


@dataclass
class _Hearing:
    """How many are heard at a time, and what the last of them sets back."""

    lock: threading.Lock = field(default_factory=threading.Lock)
    count: int = 0
    level: int = logging.NOTSET
    onward: _Onward | None = None


_HEARING = _Hearing()


@contextmanager
def _heard_alone(driver: logging.Logger) -> Iterator[None]:
    """Let a logger pass all words, without handlers above it being handed more than before.

    Those inside one another, or of several threads, may end in any order.
    """
    with _HEARING.lock:
        if not _HEARING.count:
            _HEARING.level = driver.level
            if driver.propagate:
                _HEARING.onward = _Onward(driver)
                driver.addHandler(_HEARING.onward)
                driver.propagate = False
            driver.setLevel(PASSING)
        _HEARING.count += 1
    try:
        yield
    finally:
        with _HEARING.lock:
            _HEARING.count -= 1
            if not _HEARING.count:
                driver.setLevel(_HEARING.level)
                if _HEARING.onward is not None:
                    driver.removeHandler(_HEARING.onward)
                    driver.propagate, _HEARING.onward = True, None


@contextmanager
def collected_lines() -> Iterator[list[str]]:
    """Collect the lines that are told inside instead of handing them on.

    Words for the moment pass through. For one thread at a time: the handlers are those of the
    process.
    """
    driver = logging.getLogger(LOGGER)
    level, handlers, propagate = driver.level, driver.handlers[:], driver.propagate
    lines: list[str] = []

    def passing(text: str) -> None:
        for handler in handlers:
            if isinstance(handler, ProgressHandler):
                handler.passing(text)

    driver.handlers[:] = [ProgressHandler(lines.append, passing)]
    driver.propagate = False
    driver.setLevel(PASSING)
    try:
        yield lines
    finally:
        driver.setLevel(level)
        driver.handlers[:] = handlers
        driver.propagate = propagate


@contextmanager
def quiet() -> Iterator[None]:
    """Keep lines back, for one thread at a time: those of jobs side by side would interleave."""
    with collected_lines():
        yield


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


def tenths(prefix: str) -> Callable[[Progress], None]:
    """Return what tells the progress of a simulation, a line for each tenth of its time."""
    last = 0

    def tell(progress: Progress) -> None:
        nonlocal last
        tenth = int(10 * progress.time / progress.end)
        if tenth > last:
            last = tenth
            left = progress.remaining
            to_go = "" if math.isnan(left) else f", {duration(left)} to go"
            logger.info(f"{prefix}{10 * tenth} %{to_go}")

    return tell
