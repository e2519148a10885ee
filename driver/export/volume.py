"""The specimen inside: a fitted model simulated once more, with the fields of its volume."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from driver.case.model import Case
from driver.common.formatting import cost_told
from driver.common.progress import tenths
from driver.experiment.history import History
from driver.export.vtkhdf import write_vtkhdf
from driver.forward.build import adapter_of, build_model, capabilities_of
from driver.forward.cost import simulation_memory, simulation_seconds
from driver.results.files import volume_med, volume_vtkhdf
from driver.results.reader import FittedModel
from meshes.arrays import FloatArray
from meshes.prism_mesh import PrismMesh
from solver_adapters.interface import CellFields, Progress
from solver_adapters.med_results import write_results

logger = logging.getLogger(__name__)


# Bytes of the fields of a cell at an image, held twice while they are written.
_FIELD_BYTES = 2 * 8 * (6 + 24 + 24 + 3)
# VTK's symmetric tensors run XX, YY, ZZ, XY, YZ, XZ; those of a response XX, YY, ZZ, YZ, XZ, XY.
_VTK_TENSOR = [0, 1, 2, 5, 3, 4]


@dataclass(frozen=True, eq=False)
class Volume:
    """What a model says of the inside of the specimen at the images.

    Attributes:
        mesh: the mesh, moved by the geometric parameters of the model.
        times: instants of the images [s], shape (T,).
        displacement: of all nodes [µm], shape (T, n_nodes, 3).
        cells: fields of the cells.
    """

    mesh: PrismMesh
    times: FloatArray
    displacement: FloatArray
    cells: CellFields

    @property
    def point_data(self) -> dict[str, FloatArray]:
        """Nodal fields by name."""
        return {"displacement_um": self.displacement}

    @property
    def cell_data(self) -> dict[str, FloatArray]:
        """Cell fields by name, tensors in VTK's order."""
        return {
            "stress_MPa": self.cells.stress[:, :, _VTK_TENSOR],
            "slip": self.cells.slip,
            "accumulated_slip": self.cells.accumulated_slip,
            "accumulated_slip_sum": self.cells.accumulated_slip.sum(axis=2),
            "lattice_rotation_rad": self.cells.rotation,
        }


def offers_volume(case: Case) -> bool:
    """Whether the solver of the case answers fields of the cells."""
    return adapter_of(case).capabilities().cell_fields


def simulate_volume(
    case: Case,
    mesh: PrismMesh,
    history: History,
    values: Mapping[str, float],
    progress: Callable[[Progress], None] | None = None,
    workspace: Path | None = None,
) -> Volume:
    """Run a model once, on the working mesh, for all nodes and cells at the images.

    Args:
        case: the case; its solver answers fields of the cells.
        mesh: working mesh.
        history: times and stage travel.
        values: parameters of the model; others are at their null.
        progress: called as the run advances.
        workspace: folder of the jobs of a solver that is a program of its own, or None.

    Raises:
        SolverError: the simulation could not be finished.
    """
    adapter = adapter_of(case)
    no_pixels = np.zeros((0, 2))
    model = build_model(case, mesh, history, no_pixels, adapter, case.solver.steps_per_interval)
    simulation = replace(
        model.simulation({**model.null_values(), **values}),
        output=history.image_row,
        output_nodes=np.arange(len(mesh.points)),
        cell_fields=True,
    )
    response = adapter.solve(simulation, workspace, progress)
    assert response.cells is not None
    times = history.time[history.image_row]
    return Volume(simulation.mesh, times, response.displacement, response.cells)


def volume_files(label: str, med: bool) -> tuple[str, ...]:
    """Names of the files of a model: VTKHDF, and MED where that is asked."""
    return (volume_vtkhdf(label), volume_med(label))[: 1 + med]


def write_volumes(
    folder: Path,
    case: Case,
    mesh: PrismMesh,
    history: History,
    models: Sequence[FittedModel],
    med: bool,
    workspace: Path | None = None,
) -> None:
    """Simulate each model once more and write what is inside.

    Args:
        folder: where to write, a file a model.
        case: the case; its solver answers fields of the cells.
        mesh: working mesh.
        history: times and stage travel.
        models: the fitted models.
        med: whether to write MED files beside the VTKHDF files.
        workspace: folder of the jobs of a solver that is a program of its own, or None.

    Raises:
        CommandMissingError: the program of the solver is absent.
        SolverError: a simulation could not be finished.
    """
    solver = capabilities_of(case)
    n_cells = len(mesh.cells)
    cost = cost_told(
        simulation_seconds(case, solver, n_cells, history.n_images),
        simulation_memory(
            case.specimen.cell_kind, n_cells, history.n_images, 0, case.solver.steps_per_interval
        )
        + _FIELD_BYTES * n_cells * history.n_images,
    )
    logger.info(
        f"fields of the volume: {len(models)} simulation{'s' if len(models) > 1 else ''}, "
        f"each {cost} (--no-volume leaves them out)"
    )
    for model in models:
        progress = tenths(f"  {model.label}: ")
        volume = simulate_volume(case, mesh, history, model.values, progress, workspace)
        for_paraview, for_salome = (folder / name for name in volume_files(model.label, True))
        write_vtkhdf(for_paraview, volume.mesh, volume.times, volume.point_data, volume.cell_data)
        if med:
            write_results(for_salome, volume.mesh, volume.times, volume.displacement, volume.cells)
