"""Time and memory of one simulation: a coarse model of them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType

from driver.case.model import Case
from meshes.prism import CellKind
from solver_adapters.crystal import SYSTEM_COUNTS, system_count
from solver_adapters.finite_differences import RUNS_PER_DIRECTION
from solver_adapters.interface import Capabilities, Simulation

_POINTS_PER_CELL: Mapping[CellKind, int] = MappingProxyType({"tet10": 4, "hex20": 8})
# Nodes of a cell inside a mesh, and what those at the surface add, with the power -1/3 of the
# cells: on bars and prisms of 24 to 3582 cells, told within 6 %.
_NODES_INSIDE: Mapping[CellKind, float] = MappingProxyType({"tet10": 1.5, "hex20": 3.8})
_NODES_OF_SURFACE: Mapping[CellKind, float] = MappingProxyType({"tet10": 4.6, "hex20": 13.8})

# Seconds of one core for one integration of the crystal law at one Gauss point.
_POINT_SECONDS = {"small": 2.3e-6, "finite": 5.5e-6}
# That of 48 slip systems in the place of 24 (7.5 beside 3.8 µs, 10.7 beside 7.1).
_OF_48_SYSTEMS = {"small": 2.0, "finite": 1.5}

# Matrix of an iteration, factor and solution at 7000 unknowns, with the power 1.5 of these (a long
# thin body); and what an iteration takes whatever the mesh.
_MATRIX_SECONDS: Mapping[CellKind, float] = MappingProxyType({"tet10": 0.0225, "hex20": 0.039})
_MATRIX_UNKNOWNS, _MATRIX_POWER_OF_TIME = 7000.0, 1.5
_ITERATION_SECONDS = 5e-4

# A solver that is slower at the points is slower in its matrices by this at most (SPOOLES, MUMPS).
_SLOWER_MATRIX = 5.0

# Newton iterations of a step; what derivatives add to a step, in shares of it, and for each
# direction at a Gauss point [s].
_ITERATIONS = 2.3
_DERIVATIVES_SHARE = 0.38
_DIRECTION_SECONDS: Mapping[CellKind, float] = MappingProxyType({"tet10": 0.45e-6, "hex20": 0.8e-6})

# Libraries of one process [bytes].
PROCESS_BYTES = 330e6

# Matrix, its two factors and what assembles them: growing with the power 4/3 of the cells. Measured
# on bars of 1590 to 13 429 tetrahedra and 320 to 1080 hexahedra, told within 10 %.
_MATRIX_BYTES: Mapping[CellKind, float] = MappingProxyType({"tet10": 4.7e3, "hex20": 31e3})
_MATRIX_POWER = 4 / 3
# Cells of about `MOST_WITH_TWO` unknowns of the bundled solver: from there on one factor is kept.
ONE_FACTOR_FROM: Mapping[CellKind, int] = MappingProxyType({"tet10": 6000, "hex20": 2100})
_WITH_ONE_FACTOR = 0.65

# Numbers that a Gauss point keeps for a direction: two states, three numbers of each slip system
# and nine others; what changes its H and its stress.
_POINT_NUMBERS: Mapping[int, int] = MappingProxyType(
    {count: 2 * (3 * count + 9) + 18 for count in SYSTEM_COUNTS}
)

# Copies of a response with its derivatives: of the surface, projected, whitened.
_RESPONSE_COPIES = 4

# Trajectories of a simulation: that before it, its own, and that handed over.
_TRAJECTORIES = 3


def simulation_memory(
    kind: CellKind,
    n_cells: int,
    n_images: int,
    directions: int = 0,
    steps_per_interval: int = 1,
    systems: int = SYSTEM_COUNTS[0],
) -> float:
    """Resident memory of a process that simulates once [bytes].

    Args:
        kind: of the cells.
        n_cells: cells of the mesh.
        n_images: images of the history.
        directions: of differentiation.
        steps_per_interval: time steps of a move or a hold.
        systems: length of arrays over the slip systems, one of `SYSTEM_COUNTS`.
    """
    of_image = 24.0 * n_images * nodes_of(kind, n_cells)
    # A move and a hold for each image.
    response, trajectory = of_image * (directions + 1), 2 * steps_per_interval * of_image
    points = 8.0 * n_cells * _POINTS_PER_CELL[kind] * _POINT_NUMBERS[systems] * directions
    matrix = _MATRIX_BYTES[kind] * math.pow(n_cells, _MATRIX_POWER)
    if n_cells >= ONE_FACTOR_FROM[kind]:
        matrix *= _WITH_ONE_FACTOR
    copies = _RESPONSE_COPIES * response + _TRAJECTORIES * trajectory
    return PROCESS_BYTES + matrix + points + copies


def simulation_seconds(
    case: Case,
    solver: Capabilities,
    n_cells: int,
    n_images: int,
    directions: int = 0,
) -> float:
    """Wall-clock time of one simulation, with derivatives if asked [s].

    Args:
        case: the case.
        solver: what its solver can.
        n_cells: cells of the mesh.
        n_images: images of the history, each after one move and one hold of the stage.
        directions: of differentiation.
    """
    steps = 2 * n_images * case.solver.steps_per_interval
    return steps_seconds(case, solver, n_cells, steps, directions)


def foreseen_seconds(case: Case, solver: Capabilities, simulation: Simulation) -> float:
    """Wall-clock time of a simulation of a case [s].

    Args:
        case: the case.
        solver: what its solver can.
        simulation: with the mesh, the steps and the directions that count.
    """
    steps = (len(simulation.times) - 1) * simulation.steps_per_interval
    if simulation.steps is not None:
        steps = len(simulation.steps)
    cells, directions = len(simulation.mesh.cells), len(simulation.directions)
    return steps_seconds(case, solver, cells, steps, directions)


def steps_seconds(
    case: Case, solver: Capabilities, n_cells: int, steps: int, directions: int
) -> float:
    """Seconds of one simulation with its derivatives."""
    kind = case.specimen.cell_kind
    points = n_cells * _POINTS_PER_CELL[kind]
    unknowns = 3 * nodes_of(kind, n_cells) / _MATRIX_UNKNOWNS
    matrix: float = _MATRIX_SECONDS[kind] * unknowns**_MATRIX_POWER_OF_TIME
    of_matrix = matrix * min(solver.cost, _SLOWER_MATRIX) + _ITERATION_SECONDS
    iteration = solver.cost * points * _point_seconds(case) / case.execution.threads + of_matrix
    plain = solver.start + steps * _ITERATIONS * iteration
    if solver.derivatives:
        of_directions = steps * points * directions * _DIRECTION_SECONDS[kind]
        return plain * (1 + _DERIVATIVES_SHARE * (directions > 0)) + of_directions
    # Finite differences, so many of them at a time.
    return plain * (1 + math.ceil(RUNS_PER_DIRECTION * directions / case.execution.processes))


def nodes_of(kind: CellKind, n_cells: int) -> float:
    """Nodes of a bar or a prism of so many cells, roughly.

    Args:
        kind: of the cells.
        n_cells: cells of the mesh.
    """
    surface = _NODES_OF_SURFACE[kind] * math.pow(n_cells, -1 / 3)
    return n_cells * (_NODES_INSIDE[kind] + surface)


def systems_of(case: Case) -> int:
    """Return the length of arrays over the slip systems of a case, one of `SYSTEM_COUNTS`."""
    return system_count(case.material.to_material().slip_systems)


def _point_seconds(case: Case) -> float:
    strain = case.material.strain_measure
    many = systems_of(case) > SYSTEM_COUNTS[0]
    return _POINT_SECONDS[strain] * (_OF_48_SYSTEMS[strain] if many else 1.0)
