"""The response from the files that Code_Aster has left."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from meshes.arrays import FloatArray
from solver_adapters.code_aster.cells import mean_fields
from solver_adapters.code_aster.deck import CELLS, FORCES, LISTING, NODES
from solver_adapters.code_aster.force_table import read_resultants
from solver_adapters.code_aster.listing import Steps, steps_taken
from solver_adapters.code_aster.rmed import ResultFile
from solver_adapters.interface import Response, Simulation
from solver_adapters.result_files import ResultFileError

_MOTION = ("DX", "DY", "DZ")
_PULLED, _ALONG = "S_PLUS", "DY"
_SAME_FORCE = 1e-6  # of the largest force


def read(simulation: Simulation, folder: Path) -> Response:
    """Return the response of a job.

    Args:
        simulation: what was simulated.
        folder: the folder of the job.

    Raises:
        ResultFileError: a file is missing, truncated, empty or not what it should be, or the forces
            in two of them differ.
    """
    file = ResultFile(folder / NODES)
    file.require_mesh(simulation.mesh)
    instants = simulation.times[simulation.output]
    motion = file.nodal("DEPL", instants).pick(*_MOTION)
    reaction = file.nodal("REAC_NODA", instants).pick(_ALONG)[..., 0]
    force = reaction[:, simulation.mesh.nodes[_PULLED]].sum(axis=1)
    _require_same_force(folder / FORCES, instants, force)
    steps = read_steps(folder / LISTING)
    return Response(
        displacement=motion[:, simulation.output_nodes],
        force=force,
        d_displacement=np.zeros((0, len(instants), len(simulation.output_nodes), 3)),
        d_force=np.zeros((0, len(instants))),
        steps=len(steps.ends),
        iterations=steps.iterations,
        cuts=steps.cuts,
        ends=np.array(steps.ends),
        cells=mean_fields(simulation, motion, folder / CELLS) if simulation.cell_fields else None,
    )


def _require_same_force(path: Path, instants: FloatArray, force: FloatArray) -> None:
    """Make sure that the sum of the reactions is the resultant that Code_Aster has tabulated."""
    tabulated = read_resultants(path, _PULLED, _ALONG, instants)
    apart = abs(force - tabulated)
    worst = int(apart.argmax())
    if not apart[worst] <= _SAME_FORCE * max(abs(force).max(), abs(tabulated).max()):
        raise ResultFileError(
            f"{path}: found {tabulated[worst]:g} µN on {_PULLED} at {instants[worst]:g} s; "
            f"expected {force[worst]:g} µN, the sum of REAC_NODA in {NODES}"
        )


def read_steps(path: Path) -> Steps:
    """Return the time steps that a listing tells of.

    Raises:
        ResultFileError: there is none, or it tells of none that can be read.
    """
    if not path.is_file():
        raise ResultFileError(f"{path}: no such file; expected the listing of Code_Aster")
    try:
        steps = steps_taken(path.read_text(encoding="utf-8", errors="replace"))
    except ValueError as error:
        raise ResultFileError(f"{path}: {error}; expected the listing of Code_Aster") from None
    if not steps.ends:
        raise ResultFileError(f"{path}: found no time step that converged; expected the listing")
    return steps
