"""How much each slip system of each grain slips, by a fitted model."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace

import numpy as np

from driver.forward.model import ForwardModel
from driver.identification.fit import Fit
from meshes.arrays import FloatArray, IntArray
from meshes.cells import jacobians
from solver_adapters.crystal import system_count
from solver_adapters.interface import SolverError

logger = logging.getLogger(__name__)

_MOST = 60  # images
_BYTES = 2**28  # of the fields of all cells at these images


@dataclass(frozen=True, eq=False)
class SlipActivity:
    """Accumulated slip at some of the images, the last among them.

    Attributes:
        images: their numbers, ascending, shape (n,).
        of_grains: mean of each system over the volume of each grain [1], shape
            (n, n_grains, n_systems).
        of_cells: mean of each cell at the last image, summed over the systems [1],
            shape (n_cells,).
    """

    images: IntArray
    of_grains: FloatArray
    of_cells: FloatArray


def slip_activity(model: ForwardModel, fit: Fit) -> SlipActivity | None:
    """Simulate a fitted model once more for the slips inside.

    Args:
        model: the model.
        fit: its fit, whose trajectory begins the iterations.

    Returns:
        None of a solver that tells no slips, or that is a program of its own, and where this
        simulation cannot be finished, which is told: a picture of a page is no reason to stop.
    """
    solver = model.adapter.capabilities()
    if not (solver.in_process and solver.cell_fields):
        return None
    trajectory = fit.best.prediction.response.trajectory
    if trajectory is not None:
        model = model.with_time_steps_of(trajectory.times[1:], fit.values)
        model = model.warm_started_from(trajectory, fit.values)
    mesh = model.microstructure.mesh
    systems = system_count(model.material.slip_systems)
    numbers = 6 + 2 * systems + 3  # of a cell at an image
    most = int(np.clip(_BYTES // (8 * numbers * len(mesh.cells)), 2, _MOST))
    last = model.image_row.size - 1
    images = np.unique(np.round(np.linspace(0, last, min(most, last + 1))).astype(np.int64))
    simulation = replace(
        model.simulation(fit.values), output=model.image_row[images], cell_fields=True
    )
    try:
        cells = model.adapter.solve(simulation, model.workspace).cells
    except SolverError as error:
        logger.info(f"  no slips are told: {error}")
        return None
    assert cells is not None
    slip = cells.accumulated_slip
    # In proportion to the volume: exact for cells that are swept over a section.
    volume = jacobians(simulation.mesh.points, mesh.cells)[:, :-1].mean(axis=1)
    grains = (mesh.grain == np.arange(mesh.n_grains)[:, None]) * volume
    of_grains = np.einsum("gc,tcs->tgs", grains / grains.sum(axis=1, keepdims=True), slip)
    return SlipActivity(images, of_grains, slip[-1].sum(axis=1))
