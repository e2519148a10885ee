"""What corrections cost: a coarse model of their time."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil

from driver.case.model import Case
from driver.forward.build import geometry_of, size_between
from driver.forward.cost import steps_seconds
from meshes.prism import expected_cells
from solver_adapters.interface import Capabilities


def correction_seconds(
    case: Case,
    solver: Capabilities,
    n_cells: int,
    n_images: int,
    size: float,
    runs: Sequence[int],
) -> float:
    """Wall-clock time of corrections with cells of one size [s].

    Args:
        case: the case.
        solver: what its solver can.
        n_cells: cells of the working mesh.
        n_images: images of the history.
        size: of the cells [µm].
        runs: directions of each.
    """
    intervals, divisions = 2 * n_images, case.specimen.divisions(size)
    steps = intervals * case.solver.steps_per_interval
    seconds = sum(
        steps_seconds(case, solver, cells_of_size(case, n_cells, one), steps, n)
        for one in (size, size_between(case, divisions))
        if one is not None
        for n in runs
    )
    # What finer steps change is told by the working mesh.
    steps = case.solver.steps_per_interval
    steps *= intervals * max(ceil(case.solver.fine_steps_per_interval / steps), 2)
    return seconds + len(runs) * steps_seconds(case, solver, n_cells, steps, 0)


def cells_of_size(case: Case, n_cells: int, size: float) -> int:
    """Return about how many cells a mesh of another size has.

    Args:
        case: the case.
        n_cells: cells of its working mesh.
        size: of the cells of the other mesh [µm].
    """
    specimen, kind = case.specimen, case.specimen.cell_kind
    if specimen.of_mesh:
        return round(n_cells * (specimen.mesh_size / size) ** 3)
    if kind == "tet10":
        return round(n_cells * (specimen.mesh_size / size) ** 2)
    # Whole hexahedra lie along the sides of the section, whatever size is stated.
    geometry = geometry_of(case)
    now, then = (expected_cells(geometry, one, kind) for one in (specimen.mesh_size, size))
    return round(n_cells * then / now)
