"""`prismid virtual`: a virtual experiment from a case, never made with what identifies it."""

from __future__ import annotations

import logging
from pathlib import Path
from shlex import quote

from driver.case.file_names import read_from
from driver.case.model import CASE_FILE, Case
from driver.common.errors import InputError
from driver.common.formatting import cost_told
from driver.common.parallel import blas_on_one_thread
from driver.common.progress import tenths
from driver.experiment.history import read_history
from driver.forward.build import adapter_of, capabilities_of, geometry_of, mesh_of
from driver.forward.cost import simulation_memory, simulation_seconds
from driver.results.files import TRUTH
from driver.results.mesh_sizes import sized_case
from driver.virtual.place import refuse_what_is_there, whole_or_none
from driver.virtual.settings import Virtual, read_virtual
from driver.virtual.truth import coarser_size, knots, pull, stage_program
from driver.virtual.writing import record
from meshes.cells import NAMES
from meshes.prism import CellKind

logger = logging.getLogger(__name__)

# Cells of a truth: half of those of the finer mesh of a case, and at most so many a width.
_HALF = 0.5
_DIVISIONS = 8
# Seconds of one core for one pixel of one image, with slip steps and without.
_PIXEL_SECONDS = {True: 25e-6, False: 6e-6}
# Bytes held of one pixel of one image: levels, and the true motion in two precisions.
_PIXEL_BYTES = 64


@blas_on_one_thread()
def virtual(case_path: Path, settings_path: Path | None, folder: Path, seed: int) -> None:
    """Simulate the test of a case and photograph it.

    Args:
        case_path: the case; its images need not exist, its history only where the settings give
            no cycles.
        settings_path: the settings, or None for the defaults.
        folder: where to write; absent or empty.
        seed: of relief, stage and noise.

    Raises:
        InputError: the case or a setting cannot be used, or the folder holds files.
        SolverError: the simulation could not be finished.
    """
    case = sized_case(case_path)
    settings = Virtual() if settings_path is None else read_virtual(settings_path)
    refuse_what_is_there(folder)
    truth = true_case(case, settings)
    cycles = settings.program.cycles
    path = case.path(case.history.file)
    history = stage_program(cycles) if cycles else read_history(path, stated=case.history)
    hidden = knots(history, settings.program, case.specimen.length) | settings.truth
    n_cells = len(mesh_of(truth, truth.specimen.mesh_size).cells)
    face = case.specimen.length * case.specimen.width / case.images.pixel_um**2
    steps = settings.face.slip_spacing_um > 0
    solver, coarser = adapter_of(truth).capabilities(), coarser_size(truth)
    sizes = [n_cells] if coarser is None else [n_cells, len(mesh_of(truth, coarser).cells)]
    seconds = sum(simulation_seconds(truth, solver, n, history.n_images) for n in sizes)
    seconds += _PIXEL_SECONDS[steps] * face * history.n_images
    parts = truth.solver.steps_per_interval
    memory = simulation_memory(
        truth.specimen.cell_kind, n_cells, history.n_images, steps_per_interval=parts
    )
    memory += _PIXEL_BYTES * face * history.n_images
    extrapolated = "" if coarser is None else f", extrapolated with those of {coarser:.3g} µm"
    logger.info(
        f"truth on a mesh of {truth.specimen.mesh_size:g} µm ({n_cells} cells, "
        f"{truth.specimen.cells}{extrapolated}) with {truth.solver.steps_per_interval} steps an "
        "interval, finer "
        "than the case's "
        f"{case.specimen.mesh_size:g} and {case.specimen.fine_mesh_size:g} µm with "
        f"{case.solver.steps_per_interval} and {case.solver.fine_steps_per_interval}; "
        f"{history.n_images} images, {cost_told(seconds, memory)}"
    )
    told = (tenths("  truth: "), tenths("  truth on larger cells: "))
    course = pull(truth, history, hidden, steps, *told)
    with whole_or_none(folder) as aside:
        record(aside, read_from(case, folder), course, seed, settings)
    run = f"`prismid run {quote(str(folder))}`"
    logger.info(f"{folder / CASE_FILE} written, its truth in {TRUTH}: {run}")


def true_case(case: Case, settings: Virtual) -> Case:
    """Return a case on the mesh and with the steps of its truth.

    Hexahedra with mean dilatation, where the solver has them and layers can follow the grain
    boundary: those that err least (benchmarks/numerics.md). Otherwise cells as in the case.

    Raises:
        InputError: they are not finer than those of the finer model of the case.
    """
    wanted, finest = settings.discretisation, case.specimen.fine_mesh_size
    most = case.solver.fine_steps_per_interval
    size = wanted.mesh_size_um or _size_of_truth(case)
    steps = wanted.steps_per_interval or most + 1
    for key, found, expected in (
        ("mesh_size_um", size, f"less than {finest:g}" if size >= finest else ""),
        ("steps_per_interval", steps, f"more than {most}" if steps <= most else ""),
    ):
        if expected:
            raise InputError(
                f"discretisation.{key}: found {found:g}, expected {expected}, the finest that the "
                "case identifies with: data made with the same errors would hide them"
            )
    solver = capabilities_of(case)
    layered = solver.mean_dilatation and "hex20" in {NAMES[nodes] for nodes in solver.cells}
    follows = geometry_of(case).crossed_from_side_to_side
    chosen = layered and follows and not case.specimen.boundaries_stay
    kind: CellKind = "hex20" if chosen else case.specimen.cell_kind
    mesh = {"cells": kind, "mesh_size_um": size, "fine_mesh_size_um": _HALF * size}
    run = {
        "steps_per_interval": steps,
        "fine_steps_per_interval": steps + 1,
        "mean_dilatation": solver.mean_dilatation,
    }
    return case.model_copy(
        update={
            "specimen": case.specimen.model_copy(update=mesh),
            "solver": case.solver.model_copy(update=run),
        }
    )


def _size_of_truth(case: Case) -> float:
    """Size of the cells of a truth, where none is stated [µm]."""
    specimen = case.specimen
    if specimen.of_mesh:  # one piece of each edge more
        return specimen.size_of(specimen.divisions(specimen.fine_mesh_size) + 1)
    return min(_HALF * specimen.fine_mesh_size, specimen.width / _DIVISIONS)
