"""What was read of a job, held against what was asked."""

from __future__ import annotations

import numpy as np

from solver_adapters.interface import Response, Simulation
from solver_adapters.result_files import ResultFileError


def refuse_bad_response(simulation: Simulation, response: Response) -> None:
    """Raise where what was read does not answer the simulation.

    Raises:
        ResultFileError: results of another shape, or that are not finite.
    """
    instants, nodes = len(simulation.output), len(simulation.output_nodes)
    for name, shape in (("displacement", (instants, nodes, 3)), ("force", (instants,))):
        found = getattr(response, name)
        if found.shape != shape:
            raise ResultFileError(f"results: found {name} of shape {found.shape}, expected {shape}")
        if not np.isfinite(found).all():
            raise ResultFileError(
                f"results: found {np.count_nonzero(~np.isfinite(found))} values of {name} that "
                "are not finite, expected finite numbers"
            )
