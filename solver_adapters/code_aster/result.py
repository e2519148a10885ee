"""The response from the files that Code_Aster has left."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from solver_adapters.code_aster.cells import mean_fields
from solver_adapters.code_aster.deck import CELLS, LISTING, NODES
from solver_adapters.code_aster.listing import steps_taken
from solver_adapters.code_aster.rmed import ResultFile
from solver_adapters.interface import Response, Simulation

_MOTION = ("DX", "DY", "DZ")


def read(simulation: Simulation, folder: Path) -> Response:
    """The response of a job.

    Args:
        simulation: what was simulated.
        folder: the folder of the job.

    Raises:
        ResultFileError: a file is missing, truncated, empty or not what it should be.
    """
    file = ResultFile(folder / NODES)
    file.require_mesh(simulation.mesh)
    instants = simulation.times[simulation.output]
    motion = file.nodal("DEPL", instants).pick(*_MOTION)
    reaction = file.nodal("REAC_NODA", instants).pick("DY")[..., 0]
    listing = folder / LISTING
    text = listing.read_text(encoding="utf-8", errors="replace") if listing.is_file() else ""
    steps = steps_taken(text)
    return Response(
        displacement=motion[:, simulation.output_nodes],
        force=reaction[:, simulation.mesh.nodes["S_PLUS"]].sum(axis=1),
        d_displacement=np.zeros((0, len(instants), len(simulation.output_nodes), 3)),
        d_force=np.zeros((0, len(instants))),
        steps=len(steps.ends),
        iterations=steps.iterations,
        cuts=steps.cuts,
        ends=np.array(steps.ends),
        cells=mean_fields(simulation, motion, folder / CELLS) if simulation.cell_fields else None,
    )
