"""How long a run still takes: what was foreseen, renewed by what its stages have taken."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from time import monotonic

import numpy as np

from driver.common.formatting import duration

_OVERRUN = 0.2  # of the time that a stage has taken, which it is given beyond what was foreseen
_SHORT = 1e-3  # of a stage, which a simulation takes that tells nothing of the others
_LEAST = 10.0  # s, less of which nobody waits for


@dataclass
class Remaining:
    """The stages of a run that are left, and how its time compares with what was foreseen.

    Attributes:
        foreseen: wall-clock time of each stage that is left [s], in their order.
        simulating: stages of which simulations are the time.
    """

    foreseen: dict[str, float]
    simulating: Collection[str]
    _stage: str = ""
    _began: float = 0.0
    _simulations: list[tuple[float, float]] = field(default_factory=list)
    _factor: float | None = None

    def begin(self, stage: str, now: float) -> None:
        """Take note that a stage begins.

        Args:
            stage: its name.
            now: time [s].
        """
        self._stage, self._began = stage, now

    def end(self, now: float) -> None:
        """Take note that the stage at work has ended, by which later ones of its kind are told.

        Args:
            now: time [s].
        """
        foreseen = self.foreseen.pop(self._stage, 0.0)
        if self._stage in self.simulating and foreseen > 0:
            self._factor = (now - self._began) / foreseen
        self._stage = ""

    def simulated(self, seconds: float, foreseen: float) -> None:
        """Take note of a simulation, if it is none of a few steps.

        Args:
            seconds: what it has taken [s].
            foreseen: what was foreseen [s].
        """
        if foreseen > _SHORT * self.foreseen.get(self._stage, 0.0):
            self._simulations.append((seconds, foreseen))

    @property
    def factor(self) -> float:
        """Time of simulations over what was foreseen: of a whole stage, else of those so far."""
        if self._factor is not None or not self._simulations:
            return self._factor or 1.0
        taken, foreseen = np.array(self._simulations).T
        ratio = taken / foreseen
        order = np.argsort(ratio)
        # The weighted median: one that has waited for a file tells little of the others.
        share = np.cumsum(foreseen[order]) / foreseen.sum()
        return float(ratio[order][np.searchsorted(share, 0.5)])

    def seconds(self, now: float) -> float:
        """Return what is left [s].

        Args:
            now: time [s].
        """
        factor, left = self.factor, 0.0
        for stage, foreseen in self.foreseen.items():
            whole = foreseen * (factor if stage in self.simulating else 1.0)
            if stage == self._stage:
                taken = now - self._began
                whole = max(whole - taken, _OVERRUN * taken if whole > 0 else 0.0)
            left += whole
        return left


_of_run: list[Remaining] = []


@contextmanager
def foretold(stages: Mapping[str, float], simulating: Collection[str]) -> Iterator[Remaining]:
    """Tell inside how long a run still takes.

    Args:
        stages: wall-clock time that is foreseen of each stage that is left [s], in their order.
        simulating: stages of which simulations are the time.
    """
    remaining = Remaining(dict(stages), simulating)
    _of_run.append(remaining)
    try:
        yield remaining
    finally:
        with suppress(ValueError):
            _of_run.remove(remaining)


@contextmanager
def at_work(stage: str) -> Iterator[None]:
    """Take note of the time that a stage of the run takes.

    Args:
        stage: its name.
    """
    for remaining in _of_run[-1:]:
        remaining.begin(stage, monotonic())
    yield
    for remaining in _of_run[-1:]:
        remaining.end(monotonic())


def simulated(seconds: float, foreseen: float) -> None:
    """Take note of a simulation of the run.

    Args:
        seconds: what it has taken [s].
        foreseen: what was foreseen [s].
    """
    for remaining in _of_run[-1:]:
        remaining.simulated(seconds, foreseen)


def left_of_run() -> str:
    """Say how long the run still takes, nothing where that is not known or soon over."""
    seconds = sum(remaining.seconds(monotonic()) for remaining in _of_run[-1:])
    return "" if seconds < _LEAST else f"about {duration(seconds)} left of the run"
