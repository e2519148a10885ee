"""What a run will cost: a coarse model of its time and memory."""

from __future__ import annotations

import math
from dataclasses import dataclass

from driver.case.model import Case
from driver.common.formatting import duration
from driver.diagnosis.causes.all_causes import EVERY, NAMES
from solver_adapters.finite_differences import RUNS_PER_DIRECTION
from solver_adapters.interface import Capabilities

# Gauss points of a tet10, and its nodes per cell in a mesh of a few hundred cells.
_POINTS_PER_CELL = 4
_NODES_PER_CELL = 2.2
# Seconds of one core for one integration of the crystal law at one Gauss point.
_POINT_SECONDS = {"small": 2.3e-6, "finite": 5.5e-6}
# Numeric factorisation: 39 ms at 7000 unknowns, growing with the power 1.5 (a long thin body).
_FACTOR_SECONDS, _FACTOR_UNKNOWNS, _FACTOR_POWER = 0.039, 7000.0, 1.5
# A solver that is slower at the points is slower in its matrices by this at most (SPOOLES, MUMPS).
_SLOWER_MATRIX = 5.0
# Newton iterations of a step; share of a step that one direction of differentiation adds.
_ITERATIONS = 4
_DIRECTION_SHARE = 0.05
# Simulations of a run: Gauss–Newton iterations use this share of their limit, each refit of a
# cause needs this many, one that is looked at from afar about this many without derivatives
# (both sides in two rounds), and a finer mesh is run this often where something is found.
_ITERATION_SHARE = 0.7
_PER_REFIT = 6
_PER_LOOK = 4
_FINE_RUNS = 8
# Seconds of one core of the correlation for one pixel of one image, all iterations.
_PIXEL_SECONDS = 8e-6
# Libraries of one process [bytes]; copies of the images held at a time.
_PROCESS_BYTES = 330e6
_IMAGE_COPIES = 3
# Numbers that a Gauss point keeps for a direction: two states, what changes its H and its stress.
_POINT_NUMBERS = 2 * 81 + 18
# Copies of a response with its derivatives: of the surface, projected, whitened.
_RESPONSE_COPIES = 4
# Ways of all nodes over the steps of a simulation: that before it, its own, and that handed over.
_WAYS = 3
# Parameters of all causes, which are differentiated together.
_CAUSE_DIRECTIONS = 50
# Directions of the boundary motion: 4 λ's and the knots of three cycles (6 for each of 4 motions).
_BOUNDARY_DIRECTIONS = 4 + 4 * 6


@dataclass(frozen=True)
class Cost:
    """What a run will cost.

    Attributes:
        seconds: wall-clock time of all stages [s], to a factor of two or so.
        memory: largest resident memory of all processes together [bytes].
        simulations: number of simulations on the working mesh.
    """

    seconds: float
    memory: float
    simulations: int


def estimate(
    case: Case, solver: Capabilities, n_cells: int, n_images: int, n_pixels: int = 0
) -> Cost:
    """Time and memory of a run.

    Args:
        case: the case.
        solver: what its solver can.
        n_cells: tet10 cells of the working mesh.
        n_images: images of the history, each after one move and one hold of the stage.
        n_pixels: pixels of all stacks together.
    """
    directions = len(case.identification.parameters) + _BOUNDARY_DIRECTIONS
    intervals = 2 * n_images
    working, plain = (
        _simulation(case, solver, n_cells, intervals * case.solver.steps_per_interval, n)
        for n in (directions, 0)
    )
    finer = n_cells * (case.specimen.mesh_size / case.specimen.fine_mesh_size) ** 2
    fine = _simulation(
        case, solver, round(finer), intervals * case.solver.fine_steps_per_interval, 0
    )
    fits = round(_ITERATION_SHARE * case.identification.max_iterations)
    refits = min(case.diagnosis.refit, _causes(case)) * _PER_REFIT if case.with_images else 0
    looks = _bent_causes(case) * _PER_LOOK if case.with_images else 0
    # Only further starts, refits and looks are independent of each other and run side by side.
    beside = working * (fits * (case.identification.starts - 1) + refits) + plain * looks
    solving = working * fits + beside / case.execution.processes + _FINE_RUNS * fine
    if case.boundary.jitter_nm:
        # A direction for the stop of each image, before stage B and at its result.
        solving += 2 * _simulation(
            case, solver, n_cells, intervals * case.solver.steps_per_interval, n_images
        )
    face = case.specimen.length * case.specimen.width / case.images.pixel_um**2
    correlation = _PIXEL_SECONDS * face * n_images if case.with_images else 0.0
    causes = _CAUSE_DIRECTIONS if case.with_images else 0
    steps = case.solver.steps_per_interval
    memory = simulation_memory(n_cells, n_images, directions + causes, steps)
    if case.execution.processes > 1:
        each = simulation_memory(n_cells, n_images, directions, steps)
        memory += case.execution.processes * each
    memory += _IMAGE_COPIES * 8.0 * n_pixels
    runs = 1 if solver.derivatives else 1 + RUNS_PER_DIRECTION * directions
    evaluations = fits * case.identification.starts + refits
    return Cost(solving + correlation, memory, runs * evaluations + looks)


def _causes(case: Case) -> int:
    """How many causes a case asks for, of its own files one each."""
    asked = case.diagnosis.causes
    return len(NAMES) + len(case.diagnosis.cause_files) if asked == "all" else len(asked)


def _bent_causes(case: Case) -> int:
    """How many of them may be looked at from afar."""
    asked = NAMES if case.diagnosis.causes == "all" else case.diagnosis.causes
    return sum(cause.bends for cause in EVERY if cause.name in asked)


def simulation_memory(
    n_cells: int, n_images: int, directions: int = 0, steps_per_interval: int = 1
) -> float:
    """Resident memory of a process that simulates once [bytes].

    Args:
        n_cells: tet10 cells of the mesh.
        n_images: images of the history.
        directions: of differentiation.
        steps_per_interval: time steps of a move or a hold.
    """
    of_image = 24.0 * n_images * n_cells * _NODES_PER_CELL
    # A move and a hold for each image.
    response, way = of_image * (directions + 1), 2 * steps_per_interval * of_image
    points = 8.0 * n_cells * _POINTS_PER_CELL * _POINT_NUMBERS * directions
    return _PROCESS_BYTES + points + _RESPONSE_COPIES * response + _WAYS * way


def cost_told(seconds: float, memory: float) -> str:
    """What a job will cost, in words.

    Args:
        seconds: wall-clock time on cores that do nothing else [s].
        memory: largest resident memory of all its processes together [bytes].
    """
    return f"about {duration(seconds)} on free cores and {memory / 1e9:.1f} GB of memory"


def simulation_seconds(
    case: Case,
    solver: Capabilities,
    n_cells: int,
    n_images: int,
    directions: int = 0,
    steps_per_interval: int | None = None,
) -> float:
    """Wall-clock time of one simulation, with derivatives if asked [s].

    Args:
        case: the case.
        solver: what its solver can.
        n_cells: tet10 cells of the mesh.
        n_images: images of the history, each after one move and one hold of the stage.
        directions: of differentiation.
        steps_per_interval: time steps of a move or a hold; those of the working mesh if None.
    """
    steps = 2 * n_images * (steps_per_interval or case.solver.steps_per_interval)
    return _simulation(case, solver, n_cells, steps, directions)


def _simulation(
    case: Case, solver: Capabilities, n_cells: int, steps: int, directions: int
) -> float:
    """Seconds of one simulation with its derivatives."""
    points = n_cells * _POINTS_PER_CELL * _POINT_SECONDS[case.material.strain_measure]
    unknowns = 3 * n_cells * _NODES_PER_CELL
    factor: float = _FACTOR_SECONDS * (unknowns / _FACTOR_UNKNOWNS) ** _FACTOR_POWER
    of_matrix = factor * min(solver.cost, _SLOWER_MATRIX)
    iteration = solver.cost * points / case.execution.threads + of_matrix
    plain = solver.start + steps * _ITERATIONS * iteration
    if solver.derivatives:
        return plain * (1 + _DIRECTION_SHARE * directions / _ITERATIONS)
    # Finite differences, so many of them at a time.
    return plain * (1 + math.ceil(RUNS_PER_DIRECTION * directions / case.execution.processes))
