"""CalculiX behind the common interface: files of a job, call, results."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from solver_adapters.calculix import deck, limits
from solver_adapters.calculix.dat import read_displacements, read_force
from solver_adapters.calculix.log import cause, parse_status, version_in
from solver_adapters.calculix.sta import reached, read_increments
from solver_adapters.external import ExternalAdapter, Status
from solver_adapters.interface import Capabilities, Response, Simulation
from solver_adapters.time_steps import step_ends


class CalculixAdapter(ExternalAdapter):
    """CalculiX's law SINGLE_CRYSTAL on quadratic tetrahedra or hexahedra."""

    name = "calculix"
    programs = ("ccx",)
    version_call = ("-v",)
    results = (f"{deck.JOB}.dat",)

    def capabilities(self) -> Capabilities:
        """Small strain and {110}⟨111⟩ only; Q where h_latent is that of CalculiX."""
        return limits.CAPABILITIES

    def check_supported(self, simulation: Simulation) -> None:
        """Refuse processes, {112} systems and hardening that CalculiX does not have.

        Raises:
            UnsupportedError: what CalculiX cannot do, by name.
        """
        limits.check_supported(simulation, self.profile)

    def write(self, simulation: Simulation) -> Mapping[str, bytes]:
        """Return the files of a job."""
        return deck.render_files(simulation)

    def command(self, program: tuple[str, ...]) -> tuple[str, ...]:
        """Return the call; the number of threads is in the environment."""
        return (*program, "-i", deck.JOB)

    def read(self, simulation: Simulation, folder: Path) -> Response:
        """Return the response from `job.dat` and `job.sta`.

        Raises:
            ResultFileError: one of them is missing, empty, truncated or of another job.
        """
        ends = step_ends(simulation) - simulation.times[0]
        steps = deck.output_steps(simulation)
        increments = read_increments(folder / f"{deck.JOB}.sta", ends[1:])
        nodes, n = simulation.output_nodes, len(simulation.output)
        # The first instant, where nothing has moved, is not in the files.
        force, displacement = np.zeros(len(ends)), np.zeros((len(ends), nodes.size, 3))
        printed, wanted = folder / f"{deck.JOB}.dat", ends[steps]
        if steps.size:
            force[steps] = read_force(printed, deck.FORCE_SET, wanted)[:, 1]
        if steps.size and nodes.size:
            displacement[steps] = read_displacements(printed, deck.OUTPUT_SET, wanted, nodes)
        rows = np.searchsorted(ends, simulation.times[simulation.output] - simulation.times[0])
        return Response(
            displacement=displacement[rows],
            force=force[rows],
            d_displacement=np.zeros((0, n, nodes.size, 3)),
            d_force=np.zeros((0, n)),
            steps=len(increments.ends),
            iterations=increments.iterations,
            cuts=increments.cuts,
            ends=simulation.times[0] + increments.ends,
        )

    def diagnose(self, log: str) -> Status:
        """Return what CalculiX has printed."""
        return parse_status(log)

    def cause(self, log: str) -> str:
        """Return the first error that CalculiX has printed."""
        return cause(log)

    def reached(self, simulation: Simulation, folder: Path) -> float | None:
        """Return the end of the last increment in `job.sta`."""
        spent = reached(folder / f"{deck.JOB}.sta")
        return None if spent is None else float(simulation.times[0]) + spent

    def version_in(self, answer: str) -> str | None:
        """Return the version that `ccx -v` tells."""
        return version_in(answer)
