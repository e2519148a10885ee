"""A word now and then where a long step says none, so that nobody takes it for a hang."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import monotonic

from driver.common.formatting import duration
from solver_adapters.kernels import compiling

LONGEST_SILENCE = 10.0
"""Seconds after which something is said."""
_COMPILING = "compiling numerical kernels, once on this machine"


class Silence:
    """Since when nothing was told.

    Args:
        longest: seconds after which something is said.
    """

    def __init__(self, longest: float = LONGEST_SILENCE) -> None:
        self._longest = longest
        self._line = self._word = monotonic()

    def broken(self) -> None:
        """Take note of a line."""
        self._line = self._word = monotonic()

    @contextmanager
    def told(self, tell: Callable[[str], None]) -> Iterator[None]:
        """Tell inside what is at work, and for how long, whenever nothing else was told."""
        ended = threading.Event()

        def watch() -> None:
            while not ended.wait(max(0.0, self._word + self._longest - monotonic())):
                now = monotonic()
                if now - self._word >= self._longest:
                    line, work = self._line, _COMPILING if compiling() else "at work"
                    tell(f"    {work}, no other word for {duration(now - line)}")
                    self._line, self._word = line, monotonic()

        thread = threading.Thread(target=watch, daemon=True)
        thread.start()
        try:
            yield
        finally:
            ended.set()
            thread.join()
