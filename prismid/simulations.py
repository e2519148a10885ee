"""A case simulated once at given parameters."""

from __future__ import annotations

from collections.abc import Mapping
from numbers import Real
from typing import TYPE_CHECKING

import numpy as np

from driver.case.model import Case
from driver.common.errors import InputError, one_of, show
from driver.experiment.history import History
from driver.experiment.reading import history_of
from driver.forward.build import (
    adapter_of,
    build_finer_model,
    build_model,
    capabilities_of,
    mesh_of,
    refuse_unfit_solver,
)
from driver.forward.model import ForwardModel
from driver.identification.problem import stated_start
from driver.parameters.boundary import elongation_names
from driver.results.files import IDENTIFY, job_store, make_folder, results_of
from driver.results.identification import read_identification
from driver.results.mesh_sizes import sized
from driver.workflow.engine import finished
from driver.workflow.pipeline import stages
from meshes.arrays import FloatArray
from prismid.cases import CaseLike, read
from prismid.labelled import dataset, of_images, of_points, xarray_library
from solver_adapters.kernels import use_threads

if TYPE_CHECKING:
    import xarray


def simulate(
    case: CaseLike,
    values: Mapping[str, float] | None = None,
    points: FloatArray | None = None,
    *,
    finer: bool = False,
) -> xarray.Dataset:
    """Simulate a case once, and look at it with perfect instruments.

    Args:
        case: the case as it is (with what was `changed` in it), its file or its folder.
        values: parameters of the general model by name, in µm, MPa, s, µN, rad; others are those
            that the stage identify has found, before it those at which it would start. Before it
            the elongations at the turning points, `elongation_1`, …, have to be given.
        points: X, Y of points of the face where the images show them [µm], shape (n, 2), as those
            of `surface` in `read_results`; None for the nodes of the mesh.
        finer: whether on the finer mesh, in its steps, instead of the working mesh.

    Returns:
        `motion` (image, point, component) [µm], without a shift of the stage; `load_simulated`
        (image) [µN]; `value` (parameter) of every parameter. The correction for mesh and steps is
        not in them.

    Raises:
        InputError: the case, a name, a value or a point cannot be used.
        LibraryError: xarray is not installed, which comes with `prismid[xarray]`.
        SolverError: the simulation could not be finished.

    Examples:
        >>> import prismid
        >>> case = prismid.load_case("alpha")
        >>> still = prismid.simulate(case, {f"elongation_{k}": 0.0 for k in range(1, 7)})
        >>> float(abs(still.load_simulated).max())
        0.0
    """
    xarray_library()
    stated = read(case)
    solver = capabilities_of(stated)
    stated = sized(stated, solver)
    history, specimen = history_of(stated), stated.specimen
    mesh = mesh_of(stated, specimen.mesh_size)
    refuse_unfit_solver(stated, mesh, history)
    _refuse_points(stated, points)
    workspace = None
    if solver.uses_workspace:
        make_folder(results_of(stated), stated.file)
        workspace = job_store(stated)
    use_threads(stated.execution.processes * stated.execution.threads)
    adapter = adapter_of(stated)
    looked_at = np.zeros((0, 2)) if points is None else np.asarray(points, dtype=np.float64)
    if finer:
        fine = mesh_of(stated, specimen.fine_mesh_size)
        model = build_finer_model(stated, fine, history, looked_at, adapter, workspace)
    else:
        steps = stated.solver.steps_per_interval
        model = build_model(stated, mesh, history, looked_at, adapter, steps, workspace)
    everything = _all_values(stated, model, history, values or {})
    seen = model.predict(everything)
    if points is None:
        surface = model.microstructure.moved_mesh(everything).points[model.surface_nodes]
        looked_at = surface[:, :2]
    rows, names = history.image_row, list(everything)
    units = [model.parameters[name].unit for name in names]
    motion = seen.surface if points is None else seen.motion
    return dataset(
        {
            "motion": (("image", "point", "component"), motion, "µm", "simulated motion"),
            "load_simulated": (("image",), seen.load, "µN", "simulated load"),
            "value": (("parameter",), np.array([everything[name] for name in names]), "", "value"),
        },
        of_images(history.time[rows], history.stage[rows], history.cycle)
        | of_points(looked_at)
        | {
            "parameter": (("parameter",), np.array(names), "", ""),
            "unit": (("parameter",), np.array(units), "", ""),
        },
        {"solver": adapter.name, "mesh": "finer" if finer else "working"},
    )


def _all_values(
    case: Case, model: ForwardModel, history: History, given: Mapping[str, float]
) -> dict[str, float]:
    """Return every parameter: as given, else as identified, else as at the start.

    Raises:
        InputError: a name or a value cannot be used, or nothing tells the motion of the ends.
    """
    declared = model.parameters
    for name, value in given.items():
        if name not in declared:
            raise InputError(
                f'values: found the name "{name}", expected {one_of(name, tuple(declared))}'
            )
        admissible = declared[name].admissible
        if not isinstance(value, Real) or not admissible.holds(float(value)):
            raise InputError(f"values.{name}: found {show(value)}, expected {admissible.words}")
    start = stated_start(case, model.null_values())
    if "identify" in finished(case, stages(case), ()):
        found = read_identification(results_of(case) / IDENTIFY).values
        start |= {name: value for name, value in found.items() if name in start}
    else:
        absent = [name for name in elongation_names(history.n_knots) if name not in given]
        if absent:
            raise InputError(
                f"values: found no {', '.join(absent)}, expected all elongations at turning "
                f"points, or `prismid run {case.file} --until identify` before"
            )
    return {**start, **{name: float(value) for name, value in given.items()}}


def _refuse_points(case: Case, points: FloatArray | None) -> None:
    """Raise where points are none of the face.

    Raises:
        InputError: so it is.
    """
    if points is None:
        return
    xy = np.asarray(points)
    if xy.ndim != 2 or xy.shape[1] != 2 or xy.dtype.kind not in "iuf":
        raise InputError(f"points: found the shape {xy.shape}, expected numbers X, Y, shape (n, 2)")
    half, length = case.specimen.width / 2, case.specimen.length
    outside = ~((abs(xy[:, 0]) <= half) & (xy[:, 1] >= 0) & (xy[:, 1] <= length))
    if outside.any():
        x, y = xy[int(np.argmax(outside))]
        raise InputError(
            f"points: found X = {x:g}, Y = {y:g} µm, expected points of the face: X from {-half:g} "
            f"to {half:g}, Y from 0 to {length:g}"
        )
