"""The solver in closed form that calls of a laboratory find, inside prismid and as a program."""

from __future__ import annotations

import io
import multiprocessing
import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from solver_adapters.external import ExternalAdapter, Profile, ResultFileError, Status
from solver_adapters.interface import Capabilities, Progress, Response, Simulation
from tools.closed_form import ClosedFormSolver

# Waits at the gate of the laboratory after five runs, and counts them.
_PROGRAM = """#!/bin/sh
while [ -e "$PRISMID_LABORATORY/closed" ] \\
    && [ "$(cat "$PRISMID_LABORATORY/runs" 2>/dev/null | wc -l)" -ge 5 ]; do
  [ -e "$PRISMID_LABORATORY/reached.$$" ] || : > "$PRISMID_LABORATORY/reached.$$"
  sleep 0.02
done
echo . >> "$PRISMID_LABORATORY/runs"
cp answer.npz result.npz
"""


class Closed(ClosedFormSolver):
    """The solver in closed form, which tells of each simulation."""

    def __init__(self) -> None:
        super().__init__(0.001)

    def solve(
        self,
        simulation: Simulation,
        workspace: Path | None = None,
        progress: Callable[[Progress], None] | None = None,
    ) -> Response:
        """Solve, told by an event of Python's audit."""
        worker = multiprocessing.parent_process() is not None
        sys.audit("laboratory.solve", "worker" if worker else "driver")
        return super().solve(simulation, workspace, progress)


class ClosedProgram(ExternalAdapter):
    """The same as a program of its own: a shell that hands out the answer of its deck."""

    name = "closed_form_program"
    programs = ("sh",)
    results = ("result.npz",)

    def __init__(self, profile: Profile | None = None) -> None:
        super().__init__(profile)

    def capabilities(self) -> Capabilities:
        """Return what the closed form honours, without derivatives."""
        return replace(Closed().capabilities(), derivatives=False, times=False, in_process=False)

    def write(self, simulation: Simulation) -> Mapping[str, bytes]:
        """Return the program, and its answer."""
        u, force = Closed().answer(simulation)
        # What is prescribed is answered as it was asked for, which an adapter looks at.
        _, moved, asked = np.intersect1d(
            simulation.motion_nodes, simulation.output_nodes, return_indices=True
        )
        mask, motion = simulation.motion_mask[moved], simulation.motion[simulation.output]
        u[:, asked] = np.where(mask, motion[:, moved], u[:, asked])
        answer = io.BytesIO()
        np.savez(answer, u=u, force=force)
        return {"job.sh": _PROGRAM.encode(), "answer.npz": answer.getvalue()}

    def command(self, program: tuple[str, ...]) -> tuple[str, ...]:
        """Return the call."""
        return (*program, "job.sh")

    def read(self, simulation: Simulation, folder: Path) -> Response:
        """Return what the program has handed out."""
        if not (folder / "result.npz").is_file():
            raise ResultFileError(f"{folder}: found no result.npz, expected it")
        with np.load(folder / "result.npz") as found:
            u, force = found["u"], found["force"]
        return Response(u, force, np.zeros((0, *u.shape)), np.zeros((0, *force.shape)))

    def diagnose(self, log: str) -> Status:
        """Say that all is well."""
        return Status.DONE
