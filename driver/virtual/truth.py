"""What happens to a virtual specimen: its test simulated finer than anything that identifies it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from driver.case.model import Case
from driver.case.specimen import SIZES
from driver.common.errors import InputError, one_of
from driver.experiment.history import History, turning_points
from driver.forward.build import adapter_of, build_model, mesh_of, next_coarser
from driver.forward.mesh_extrapolation import extrapolated_with
from driver.forward.model import ForwardModel
from driver.parameters.boundary import AMPLITUDE_DECLARATIONS, elongation_names, tilt_names
from driver.virtual.settings import Program
from meshes.arrays import FloatArray
from meshes.prism_mesh import PrismMesh
from meshes.surface import SurfaceMesh, trace
from solver_adapters.crystal import SystemTable
from solver_adapters.interface import Adapter, Progress, Response, Simulation
from solver_adapters.parameter import Parameter

_STAGE_SPEED, _STOP, _HOLD = 0.5, 5.0, 30.0  # µm/s, µm between two images, s before each


@dataclass(frozen=True, eq=False)
class Course:
    """What happened to a specimen: T images, n nodes of the measured face.

    Attributes:
        history: times, stage travel and images; its forces have no meaning.
        mesh: the specimen, undeformed.
        orientations: of its grains, shape (n_grains, 3, 3).
        face: the measured face.
        motion: motion of its nodes as the images show it [µm], shape (T, n, 3).
        load: load reading without noise [µN], shape (T,).
        systems: its slip systems.
        slip: signed slip of the cells, shape (T, n_cells, n_systems), or None.
        values: the truth: every parameter of the general model.
    """

    history: History
    mesh: PrismMesh
    orientations: FloatArray
    face: SurfaceMesh
    motion: FloatArray
    load: FloatArray
    systems: SystemTable
    slip: FloatArray | None
    values: Mapping[str, float]


def course_of(
    simulation: Simulation, response: Response, history: History, values: Mapping[str, float]
) -> Course:
    """Return the course that a solver's answer describes, seen by perfect instruments.

    Args:
        simulation: what was solved; the nodes of the face are among its output nodes, its
            outputs are the images.
        response: the answer of any solver.
        history: times, stage travel and images.
        values: the parameters behind it, which go into the record of the truth.

    Raises:
        ValueError: a node of the face is not among the output nodes.
    """
    face = trace(simulation.mesh)
    place = {int(node): row for row, node in enumerate(simulation.output_nodes)}
    absent = [int(node) for node in face.nodes if int(node) not in place]
    if absent:
        raise ValueError(
            f"output nodes: found none of {len(absent)} nodes of the face TOP (the first is "
            f"{absent[0]}), expected all"
        )
    rows = [place[int(node)] for node in face.nodes]
    return Course(
        history=history,
        mesh=simulation.mesh,
        orientations=simulation.orientations,
        face=face,
        motion=response.displacement[:, rows],
        load=response.force,
        systems=simulation.material.slip_systems,
        slip=None if response.cells is None else response.cells.slip,
        values=values,
    )


def pull(
    truth: Case,
    history: History,
    hidden: Mapping[str, float],
    cell_slip: bool = False,
    progress: Callable[[Progress], None] | None = None,
    progress_of_larger: Callable[[Progress], None] | None = None,
) -> Course:
    """Simulate a test; on hexahedra it is extrapolated to cells of no size.

    Args:
        truth: the specimen as it is, on the mesh and with the steps of its working model.
        history: times, stage travel and images.
        hidden: true values of parameters of the general model, the knots among them; all others
            are at their null, the law and λ's as in the case.
        cell_slip: whether slip is wanted for slip steps.
        progress: called as the run advances.
        progress_of_larger: called as that on the larger cells advances, which follows.

    Raises:
        InputError: a parameter is unknown or out of its bounds, or the solver lacks slips.
        SolverError: the simulation could not be finished.
    """
    adapter = adapter_of(truth)
    if cell_slip and not adapter.capabilities().cell_fields:
        raise InputError(
            f"face.slip_spacing_um: found slip steps with the solver {adapter.name}, which does "
            "not answer the slip of the cells, expected 0"
        )
    model, values = true_model(truth, history, adapter, hidden)
    simulation = replace(model.simulation(values), cell_fields=cell_slip)
    course = seen_course(model, simulation, history, values, progress)
    size = coarser_size(truth)
    if size is None:
        return course
    larger = truth.with_values_at({f"specimen.{SIZES[0]}": size})
    coarser, _ = true_model(larger, history, adapter, hidden)
    pair = extrapolated_with(model, coarser).extrapolation
    assert pair is not None
    less = seen_course(coarser, coarser.simulation(values), history, values, progress_of_larger)
    return replace(
        course,
        motion=pair.motion(course.motion, less.motion),
        load=pair.load(course.load, less.load),
    )


def coarser_size(truth: Case) -> float | None:
    """Size of the larger hexahedra with which a truth is extrapolated [µm], None for others."""
    specimen = truth.specimen
    return next_coarser(truth, specimen.divisions(specimen.mesh_size))


def true_model(
    truth: Case, history: History, adapter: Adapter, hidden: Mapping[str, float]
) -> tuple[ForwardModel, dict[str, float]]:
    """Return the specimen as it is, without a pixel on it, and the true value of every parameter.

    Args:
        truth: the specimen, on the mesh and with the steps of its working model.
        history: times, stage travel and images.
        adapter: the solver.
        hidden: as `pull`.

    Raises:
        InputError: a parameter is unknown or out of its bounds.
    """
    mesh = mesh_of(truth, truth.specimen.mesh_size)
    steps = truth.solver.steps_per_interval
    model = build_model(truth, mesh, history, np.zeros((0, 2)), adapter, steps)
    amplitudes = {one.name: truth.value_at(one.key) for one in AMPLITUDE_DECLARATIONS}
    values = model.null_values() | amplitudes
    refuse_unknown(hidden, model.parameters)
    return model, values | dict(hidden)


def seen_course(
    model: ForwardModel,
    simulation: Simulation,
    history: History,
    values: Mapping[str, float],
    progress: Callable[[Progress], None] | None = None,
) -> Course:
    """Simulate what happens; images and load cell show it as they truly are.

    Args:
        model: the specimen as it is.
        simulation: `model.simulation(values)`, or one in which more happens.
        history: times, stage travel and images.
        values: the true value of every parameter.
        progress: called as the run advances.

    Raises:
        SolverError: the simulation could not be finished.
    """
    response = model.adapter.solve(simulation, progress=progress)
    seen = model.observe(response, values, ())
    bare = course_of(simulation, response, history, values)
    # A load that lags is read between the rows, and then every row is answered.
    at_images = np.searchsorted(simulation.output, history.image_row)
    slip = None if bare.slip is None else bare.slip[at_images]
    return replace(bare, motion=seen.surface, load=seen.load, slip=slip)


def knots(history: History, program: Program, length: float) -> dict[str, float]:
    """Elongation and tilt of the specimen at the turning points [µm], by parameter name.

    Loading elongates in proportion to the stage travel, unloading gives back what is elastic.

    Args:
        history: times and stage travel.
        program: how much.
        length: of the specimen [µm].
    """
    stage = history.stage[history.turning] - history.stage[0]
    loaded = program.largest_strain * length * stage / stage.max()
    elongation = loaded.copy()
    for k in range(1, len(stage)):
        if stage[k] < stage[k - 1]:
            back = min(program.recovered_strain * length, loaded[k - 1] - loaded[k])
            elongation[k] = elongation[k - 1] - back
    free = elongation[1:]
    names = zip(elongation_names(history.n_knots), tilt_names(history.n_knots), strict=True)
    return {
        name: float(value)
        for (stretch, tilt), e in zip(names, free, strict=True)
        for name, value in ((stretch, e), (tilt, program.tilt_share * e))
    }


def stage_program(cycles: Sequence[tuple[int, int]]) -> History:
    """Return a test of moves of 5 µm, each with a hold and an image after it.

    Args:
        cycles: images during loading and during unloading of each cycle.
    """
    time, stage, rows = 0.0, 0.0, [(0.0, 0.0, True)]
    for up, down in cycles:
        for step in up * [_STOP] + down * [-_STOP]:
            time, stage = time + _STOP / _STAGE_SPEED, stage + step
            rows.append((time, stage, False))
            time += _HOLD
            rows.append((time, stage, True))
    return history_of_rows(rows)


def history_of_rows(rows: Sequence[tuple[float, float, bool]]) -> History:
    """Make a history without loads of rows: time [s], travel [µm], whether an image is taken."""
    times, travel, taken = (np.array(column) for column in zip(*rows, strict=True))
    images = np.flatnonzero(taken)
    none = np.zeros(images.size)
    return History(times, travel, images, none, turning_points(travel), none.astype(np.int64))


def refuse_unknown(hidden: Mapping[str, float], declared: Mapping[str, Parameter]) -> None:
    """Refuse true values of parameters that are not of the general model, or out of bounds.

    Args:
        hidden: true values by name.
        declared: the parameters of the general model, with the bounds of the case.

    Raises:
        InputError: naming the parameter.
    """
    for name, value in hidden.items():
        if name not in declared:
            expected = one_of(name, tuple(declared))
            raise InputError(f'truth: found the name "{name}", expected {expected}')
        lower, upper = declared[name].lower, declared[name].upper
        if not lower <= value <= upper:
            raise InputError(
                f"truth.{name}: found {value:g}, expected a number from {lower:g} to {upper:g}"
            )
