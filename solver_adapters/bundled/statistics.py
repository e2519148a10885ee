"""What a run has cost so far."""

from __future__ import annotations

import time
from dataclasses import dataclass, field


@dataclass
class Statistics:
    """Counts and times of a run.

    Attributes:
        steps: time steps taken.
        iterations: Newton iterations in all.
        cuts: steps that had to be cut to converge.
        refinements: steps that had to be cut to be accurate.
        ends: ends of the steps [s].
        seconds: wall-clock time by component [s].
    """

    steps: int = 0
    iterations: int = 0
    cuts: int = 0
    refinements: int = 0
    ends: list[float] = field(default_factory=list)
    seconds: dict[str, float] = field(default_factory=dict)

    def clock(self, name: str, since: float) -> float:
        """Book the time since an earlier call; returns now."""
        now = time.perf_counter()
        self.seconds[name] = self.seconds.get(name, 0.0) + now - since
        return now
