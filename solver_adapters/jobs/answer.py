"""What was read of a job, held against what was asked."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from solver_adapters.interface import Response, Simulation
from solver_adapters.jobs.key import what_is_computed
from solver_adapters.result_files import ResultFileError

_SAME_INSTANT = 1e-6  # of the time; result files have seven digits of it
_DIGITS = 1e-5
"""What a result file with six digits may miss, in shares of the largest displacement."""


def refuse_bad_response(simulation: Simulation, response: Response) -> None:
    """Raise where what was read does not answer the simulation.

    Raises:
        ResultFileError: results of another shape, that are not finite, or of another motion.
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
    _refuse_steps_that_pass_instants(simulation, response)
    _refuse_other_motion(simulation, response)


def _refuse_steps_that_pass_instants(simulation: Simulation, response: Response) -> None:
    """Refuse steps that end at no instant, where the program tells its steps at all."""
    if not response.ends.size:
        return
    times = simulation.times[1:]
    gap = abs(response.ends - times[:, None]).min(axis=1)
    late = gap > _SAME_INSTANT * np.maximum(1.0, abs(times))
    if late.any():
        raise ResultFileError(
            f"results: found {response.ends.size} time steps up to {response.ends[-1]:g} s, none "
            f"of which ends at {times[late][0]:g} s and at {late.sum() - 1} other instants; "
            "expected one that ends at every instant: the listing of the run is not whole"
        )


def _refuse_other_motion(simulation: Simulation, response: Response) -> None:
    """Where the motion was prescribed, the answer must be that motion."""
    _, moved, asked = np.intersect1d(
        simulation.motion_nodes, simulation.output_nodes, return_indices=True
    )
    mask = simulation.motion_mask[moved]
    prescribed = np.where(mask, simulation.motion[simulation.output][:, moved], 0.0)
    off = np.abs(response.displacement[:, asked] * mask - prescribed)
    largest = np.abs(response.displacement).max(initial=np.abs(prescribed).max(initial=0.0))
    if off.max(initial=0.0) > _DIGITS * largest:
        row, node, axis = np.unravel_index(np.argmax(off), off.shape)
        raise ResultFileError(
            f"results: found {response.displacement[row, asked[node], axis]:.6g} µm along "
            f"{'XYZ'[axis]} at node {simulation.motion_nodes[moved[node]]}, expected "
            f"{prescribed[row, node, axis]:.6g} µm as prescribed; they are of another simulation"
        )


def refuse_other_deck(folder: Path, files: Mapping[str, bytes]) -> None:
    """Raise where the deck in the folder of a job is not the one that its simulation has.

    Args:
        folder: the folder of the job.
        files: files of the job by name, as they are written now. Binary ones and provenance
            headers are no part of it, as in `job_key`; ends of lines neither.

    Raises:
        ResultFileError: a file is missing or another one; the results may be of anything.
    """
    for name in sorted(files):
        if b"\0" in files[name]:
            continue
        try:
            found = (folder / name).read_bytes()
        except OSError as error:
            raise ResultFileError(
                f"{folder / name}: {error.strerror}, expected the file that prismid has written"
            ) from None
        lines, expected = (what_is_computed(t).splitlines() for t in (found, files[name]))
        if lines != expected:
            pairs = zip(lines, expected, strict=False)
            same = next((i for i, (a, b) in enumerate(pairs) if a != b), len(expected))
            raise ResultFileError(
                f"{folder / name}: found a file that was changed (line {same + 1} without its "
                "header), expected the one that prismid has written"
            )
