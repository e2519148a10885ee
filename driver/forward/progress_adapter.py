"""A solver whose runs are told while they go."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from pathlib import Path
from time import monotonic

from driver.common.progress import PASSING
from driver.common.remaining import simulated
from solver_adapters.interface import Adapter, Capabilities, Progress, Response, Simulation
from solver_adapters.kernels import compilations

_READ = 0.01  # share of its time, below which a job was not run

logger = logging.getLogger(__name__)


class ProgressAdapter:
    """An adapter that tells the progress of its runs, in this process only.

    Attributes:
        inner: the solver. Sent to another process, it goes alone.
        name: that of the solver.
        foreseen: how long a run takes, by an estimate [s], to renew that of all; None for none.
    """

    def __init__(
        self, inner: Adapter, foreseen: Callable[[Simulation], float] | None = None
    ) -> None:
        self.inner = inner
        self.name = inner.name
        self.foreseen = foreseen

    def capabilities(self) -> Capabilities:
        """Return what the solver can honour."""
        return self.inner.capabilities()

    def version(self) -> str:
        """Identity of the solver."""
        return self.inner.version()

    def solve(
        self,
        simulation: Simulation,
        workspace: Path | None = None,
        progress: Callable[[Progress], None] | None = None,
    ) -> Response:
        """Run a simulation; what it raises is what the solver raises."""
        told = False

        def show(state: Progress) -> None:
            nonlocal told
            told = True
            if state.time < state.end:
                logger.log(PASSING, sentence_of(state))
            if progress is not None:
                progress(state)

        began, compiled = monotonic(), compilations()
        response = self.inner.solve(simulation, workspace, show)
        seconds, foreseen = monotonic() - began, self.foreseen and self.foreseen(simulation)
        # What an interrupted run has kept is only read: in this process nothing is told meanwhile.
        in_process = self.inner.capabilities().in_process
        # One that has compiled kernels took a thousand times as long as the others will.
        if not foreseen or compilations() > compiled:
            return response
        if told if in_process else seconds > _READ * foreseen:
            simulated(seconds, foreseen)
        return response

    def __reduce__(self) -> tuple[Callable[[Adapter], Adapter], tuple[Adapter]]:
        return _alone, (self.inner,)


def sentence_of(state: Progress) -> str:
    """How far a simulation is: `at 120 of 3840 s: 6 steps, 21 iterations, 0 cut, 12 s left`.

    Runs of a finite difference are counted before it: `run 7 of 46: simulation at …`.
    """
    run = f"run {state.run} of {state.runs}: " if state.runs > 1 else ""
    if state.holder:
        return f"{run}waiting for {state.holder}, which runs this simulation"
    steps = f"{state.steps} steps, {state.iterations} iterations, {state.cuts} cut"
    parts = [steps] if state.steps else []
    parts += [] if math.isnan(state.remaining) else [f"{state.remaining:.0f} s left"]
    details = f": {', '.join(parts)}" if parts else ""
    return f"{run}simulation at {state.time:.4g} of {state.end:.4g} s{details}"


def _alone(inner: Adapter) -> Adapter:
    return inner
