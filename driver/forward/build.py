"""From a case to the objects that compute with it: geometry, meshes, images, forward model."""

from __future__ import annotations

from math import ceil
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from driver.case.file_names import TRACE
from driver.case.model import Case
from driver.case.solver_profiles import profile_of
from driver.case.user_mesh import mesh_of_file
from driver.common.errors import InputError, sentence
from driver.dic.region import pixels_on, within
from driver.dic.surface_images import SurfaceImages, prepare
from driver.experiment.history import History, knot_weights
from driver.experiment.images.flatfield import FlatField, flat_pattern
from driver.experiment.images.reference import Reference, build_reference, stated_reference
from driver.experiment.labels import columns_of_case
from driver.experiment.orientations import orientations_of, rotation_scales
from driver.experiment.reading import Experiment
from driver.forward.boundary_motion import BoundaryMotion
from driver.forward.instrument import Instrument
from driver.forward.mesh_extrapolation import extrapolated_with
from driver.forward.microstructure import build_microstructure
from driver.forward.model import ForwardModel
from driver.forward.surface_projection import PixelProjection
from driver.parameters.registry import declared_parameters
from driver.parameters.user_terms import BoundaryTerm, ReadingTerm, terms_of
from meshes.arrays import FloatArray
from meshes.cells import NAMES
from meshes.columnar import generate_columns
from meshes.plane_files import read_plane_mesh
from meshes.plane_mesh import PlaneMesh
from meshes.prism import MOST_CELLS, PrismGeometry, generate, refuse_too_many
from meshes.prism_mesh import PrismMesh
from meshes.surface import trace
from meshes.uniform_split import in_pieces
from solver_adapters.external import ExternalAdapter
from solver_adapters.finite_differences import FiniteDifferences
from solver_adapters.grain_scalars import as_honoured
from solver_adapters.interface import Adapter, Capabilities, Integration
from solver_adapters.material import MATERIAL_PARAMETERS
from solver_adapters.parameter import Parameter
from solver_adapters.registry import find_adapter

_SMALLER = (0.93, 0.9, 0.87, 0.84, 0.8, 0.75)  # elements of the second mesh over those of the first
_TWO_THIRDS = 2 / 3  # elements of a second mesh of the user's own over those of the first
_THREE_QUARTERS = 0.75  # hexahedra of a second mesh over those of the first, at most
_NEXT_COARSER = 0.75  # cells along a side of a mesh to extrapolate with, over those of the finer
_COMMON = 0.2  # share of its nodes that it may have in common with the first
_SAME = 0.02  # element sizes between two nodes that are as good as the same


def geometry_of(case: Case) -> PrismGeometry:
    """Return the prism and its plane grain boundaries, of which labels tell none.

    Of a mesh of the user's own it is the bar about it.
    """
    s = case.specimen
    return PrismGeometry(s.length, s.width, s.depth, s.planes, s.bottom)


def mesh_of(case: Case, size: float) -> PrismMesh:
    """Return a mesh of the specimen with elements of a size [µm].

    Raises:
        InputError: the case does not describe a prism that can be meshed.
    """
    specimen = case.specimen
    if specimen.mesh_file is not None:
        whole = mesh_of_file(case.path(specimen.mesh_file))
        return in_pieces(whole, specimen.divisions(size))
    columns = columns_of_case(case)
    try:
        if columns is not None:
            return generate_columns(geometry_of(case), columns, size)
        return generate(geometry_of(case), size, case.specimen.cell_kind)
    except (ValueError, RuntimeError) as error:
        instead = ', or cells = "tet10"' if case.specimen.cell_kind == "hex20" else ""
        raise InputError(f"specimen: {error}{instead}") from None


def refuse_size(case: Case, key: str, size: float) -> None:
    """Refuse a size of a mesh before that is made.

    Args:
        case: the case.
        key: that states the size.
        size: of its cells [µm].

    Raises:
        InputError: the case does not describe a prism, or the cells would be too many.
    """
    if case.specimen.mesh_file is not None:
        path, pieces = case.path(case.specimen.mesh_file), case.specimen.divisions(size)
        cells = len(mesh_of_file(path).cells) * pieces**3
        if cells > MOST_CELLS:
            found = f"cells that are {cells} with edges in {pieces} pieces"
            raise InputError(
                sentence(path, "specimen.mesh_file", found, f"at most {MOST_CELLS}, a coarser mesh")
            )
        return
    try:
        geometry = geometry_of(case)
    except ValueError as error:
        raise InputError(f"specimen: {error}") from None
    try:
        refuse_too_many(geometry, size, case.specimen.cell_kind)
    except ValueError as error:
        raise InputError(f"specimen.{key}: {error}") from None


def second_mesh_is_better(case: Case) -> bool:
    """Whether the second finer mesh has smaller cells of one family, whose error is known."""
    return case.specimen.cell_kind == "hex20" and not case.specimen.of_mesh


def size_of_second_mesh(case: Case) -> float:
    """Size of the cells of the second finer mesh, of tetrahedra about [µm].

    Hexahedra: the largest that are at most three quarters of those of the first one, of which a
    whole number is on half of the longest side.
    """
    specimen = case.specimen
    if second_mesh_is_better(case):
        divisions = specimen.divisions(specimen.fine_mesh_size)
        return specimen.size_of(ceil(divisions / _THREE_QUARTERS))
    return (_TWO_THIRDS if specimen.of_mesh else _SMALLER[2]) * specimen.fine_mesh_size


def second_mesh_of(case: Case, points: FloatArray) -> PrismMesh:
    """Return the second finer mesh of a case.

    Hexahedra: the smaller cells of `size_of_second_mesh`. A mesh of the user's own: cells of two
    thirds of the size. Tetrahedra: cells somewhat smaller with
    few nodes in common; numbers of elements along an edge are whole, and meshes of nearly the same
    size may be the same, so that it is the largest of six with at most a fifth in common, or the
    smallest where none has.

    Args:
        case: the case.
        points: of the first finer mesh, its nodes [µm], shape (n, 3).

    Raises:
        InputError: the prism cannot be meshed with such elements.
    """
    size = case.specimen.fine_mesh_size
    if second_mesh_is_better(case) or case.specimen.of_mesh:
        return mesh_of(case, size_of_second_mesh(case))
    nodes, mesh = cKDTree(points), mesh_of(case, _SMALLER[0] * size)
    for smaller in _SMALLER[1:]:
        if np.mean(nodes.query(mesh.points)[0] < _SAME * size) <= _COMMON:
            break
        mesh = mesh_of(case, smaller * size)
    return mesh


def capabilities_of(case: Case) -> Capabilities:
    """Return what the solver that the case names can do by itself.

    Raises:
        UnsupportedError: there is no such solver.
    """
    return find_adapter(case.solver.name, profile_of(case)).capabilities()


def adapter_of(case: Case, prepare_only: bool = False) -> Adapter:
    """Return the solver that the case names, able to do what the case asks, with derivatives.

    Args:
        case: the case.
        prepare_only: whether its jobs are written for another machine instead of being run.

    Raises:
        InputError: there is no such solver, or it lacks the strain measure.
    """
    adapter = find_adapter(case.solver.name, profile_of(case, prepare_only))
    wanted = case.material.strain_measure
    if wanted not in adapter.capabilities().strain_measures:
        offered = ", ".join(sorted(adapter.capabilities().strain_measures))
        raise InputError(
            f'material.strain_measure: found "{wanted}", expected one of {offered} '
            f"(what the solver {case.solver.name} offers)"
        )
    if adapter.capabilities().derivatives:
        return adapter
    # Threads wait for programs; a solver inside this process may not be made for two of them.
    outside = isinstance(adapter, ExternalAdapter)
    return FiniteDifferences(adapter, case.execution.processes if outside else 1)


def refuse_unfit_solver(case: Case, mesh: PrismMesh, history: History) -> None:
    """Raise where the solver of a case cannot simulate or identify its model.

    Args:
        case: the case.
        mesh: its working mesh.
        history: times and stage travel.

    Raises:
        InputError: the solver lacks the strain measure, the scheme or a parameter to identify.
        UnsupportedError: it cannot honour a value of the model.
    """
    solver = find_adapter(case.solver.name, profile_of(case))
    refuse_parameters(case, solver.capabilities())
    steps = case.solver.steps_per_interval
    model = build_model(case, mesh, history, np.zeros((0, 2)), adapter_of(case), steps)
    if isinstance(solver, ExternalAdapter):
        solver.files(model.simulation(model.null_values()))


def refuse_parameters(case: Case, solver: Capabilities) -> None:
    """Raise where cells, parameters to identify, or extensions, are none that the solver honours.

    Raises:
        InputError: there are some, a sentence a line.
    """
    name = case.solver.name
    expected = f"one that {name} honours: {', '.join(sorted(solver.material))}"
    unknown = frozenset(MATERIAL_PARAMETERS) - solver.material
    refused = [
        sentence(case.file, place, f'"{parameter}"', expected)
        for place, names in (
            ("identification.parameters", case.identification.parameters),
            ("extensions", case.extensions),
        )
        for parameter in names
        if as_honoured(parameter) in unknown
    ]
    known = [f'"{NAMES[nodes]}"' for nodes in sorted(solver.cells)]
    if f'"{case.specimen.cell_kind}"' not in known:
        cells = f"{' or '.join(known)}, which {name} has"
        key = "specimen.mesh_file" if case.specimen.of_mesh else "specimen.cells"
        refused.append(sentence(case.file, key, f'"{case.specimen.cell_kind}"', cells))
    elif case.mean_dilatation and not solver.mean_dilatation:
        found = "true" if case.solver.mean_dilatation else "no value, which is true with hexahedra"
        lacking = f"false: {name} lacks it"
        refused.append(sentence(case.file, "solver.mean_dilatation", found, lacking))
    if refused:
        raise InputError("\n".join(refused))


def integration_of(case: Case, solver: Capabilities) -> Integration:
    """Return the scheme that the case names, or the best that the solver has.

    Raises:
        InputError: the solver lacks the scheme that the case names.
    """
    offered, named = solver.integrations, case.solver.integration
    if named is not None and named not in offered:
        raise InputError(
            f'solver.integration: found "{named}", expected {" or ".join(sorted(offered))} (what '
            f"the solver {case.solver.name} offers), or the key left out"
        )
    return named or ("exponential" if "exponential" in offered else "backward_euler")


def surface_images(case: Case, experiment: Experiment) -> SurfaceImages:
    """Return the corrected images over the measured face, or the part of it that the meshes cover.

    Raises:
        InputError: a mesh of the correlation cannot be used.
        ImageError: the images do not fit together, or show no part of the face.
    """
    meshes = [mesh for mesh in correlation_meshes(case) if isinstance(mesh, PlaneMesh)]
    bounds, mask = within(meshes, used_face(case)), experiment.mask
    if meshes:
        shape = experiment.frames.shape[1:]
        covered = pixels_on(meshes, shape, experiment.pixel_um, experiment.origin)
        mask = covered if mask is None else mask & covered
    flat = None if experiment.flats is None else flat_pattern(experiment.flats)
    return prepare(
        experiment.frames,
        experiment.repeats,
        flat,
        experiment.pixel_um,
        experiment.origin,
        bounds,
        mask,
        case.images.dust == "mask",
        experiment.gamma_f,
    )


def correlation_meshes(case: Case) -> tuple[float | PlaneMesh, float | PlaneMesh]:
    """Element size [µm] or mesh of u and v in the correlation, and that of w.

    Raises:
        InputError: a mesh file cannot be used.
    """
    dic, pixel = case.dic, case.images.pixel_um
    return (
        _correlation_mesh(case, "mesh") or dic.element_px * pixel,
        _correlation_mesh(case, "height_mesh") or dic.height_element_px * pixel,
    )


def _correlation_mesh(case: Case, key: str) -> PlaneMesh | None:
    name: str | None = getattr(case.dic, key)
    if name is None:
        return None
    if name == TRACE:
        return trace(mesh_of(case, case.specimen.mesh_size)).plane
    try:
        return read_plane_mesh(case.path(name))
    except ValueError as error:
        raise InputError(f"{case.path(name)}: dic.{key}: {error}") from None


def reference_of(case: Case, experiment: Experiment, flat: FlatField | None) -> Reference:
    """Return the reference surface alone, without repeats that of image 0.

    Raises:
        InputError: it shows no part of the face.
    """
    place = (
        flat, experiment.pixel_um, experiment.origin, used_face(case), experiment.mask,
        case.images.dust == "mask",
    )  # fmt: skip
    if experiment.repeats is None:
        return stated_reference(experiment.frames[0], experiment.gamma_f, *place)
    return build_reference(experiment.repeats, *place)


def used_face(case: Case) -> tuple[float, float, float, float]:
    """Bounds (x0, x1, y0, y1) of the measured face without its rim [µm]."""
    half, rim = case.specimen.width / 2, case.images.rim_px * case.images.pixel_um
    return -half + rim, half - rim, rim, case.specimen.length - rim


def build_model(
    case: Case,
    mesh: PrismMesh,
    history: History,
    pixels: FloatArray,
    adapter: Adapter,
    steps_per_interval: int,
    workspace: Path | None = None,
) -> ForwardModel:
    """Return the forward model of a specimen.

    Args:
        case: the case.
        mesh: mesh of the specimen.
        history: times and stage travel.
        pixels: X, Y of the pixels of the region of interest [µm], shape (n_pix, 2).
        adapter: the solver.
        steps_per_interval: time steps between two rows of the history.
        workspace: where the solver keeps files of its runs, or None.

    Raises:
        InputError: a grain boundary cannot be moved along the specimen.
        OrientationError: an EBSD map cannot be used.
    """
    surface = trace(mesh)
    half, solver = case.specimen.width / 2, case.solver
    geometry = geometry_of(case)
    if not geometry.crossed_from_side_to_side:
        key = "boundaries.1" if case.specimen.boundaries else "boundary_normal"
        raise InputError(
            f"specimen.{key}: found {case.specimen.planes[0]}, which meets an end face or a side "
            "along the whole specimen, expected one that crosses it from side to side, or labels"
        )
    # The finer simulation is as much more accurate as its steps are shorter.
    finer = steps_per_interval / solver.steps_per_interval
    duration = history.time[-1] - history.time[0]
    return ForwardModel(
        material=case.material.to_material(),
        microstructure=build_microstructure(
            mesh, geometry, orientations_of(case), rotation_scales(case)
        ),
        boundary=_boundary_motion(case, mesh, knot_weights(history)),
        instrument=Instrument(
            surface.points,
            (history.time[history.image_row] - history.time[0]) / duration,
            (0.0, case.specimen.length / 2),
            terms_of(ReadingTerm),
        ),
        times=history.time,
        image_row=history.image_row,
        surface_nodes=surface.nodes,
        adapter=adapter,
        integration=integration_of(case, adapter.capabilities()),
        steps_per_interval=steps_per_interval,
        accuracy=None if solver.accuracy_uN is None else solver.accuracy_uN / finer,
        projection=PixelProjection(surface, pixels, (-half, half, 0.0, case.specimen.length)),
        tet10_points=solver.gauss_points,
        mean_dilatation=case.mean_dilatation,
        workspace=workspace,
    )


def parameters_of(case: Case, n_knots: int) -> dict[str, Parameter]:
    """Every parameter of the general model by name, with its scale in a case.

    Args:
        case: the case.
        n_knots: turning points of its history.

    Raises:
        OrientationError: an EBSD map cannot be used.
    """
    return declared_parameters(
        n_knots, case.material.to_material(), rotation_scales(case), len(case.grains)
    )


def build_finer_model(
    case: Case,
    mesh: PrismMesh,
    history: History,
    pixels: FloatArray,
    adapter: Adapter,
    workspace: Path | None = None,
) -> ForwardModel:
    """Return the forward model on a finer mesh, asked for finer steps.

    A correction takes those on the working mesh.

    Hexahedra that are finer than those of the working mesh by more than one step of the family are
    extrapolated with larger ones of their own; others with the working mesh, by who has both.

    Args:
        case: the case.
        mesh: the finer mesh.
        history: as in `build_model`.
        pixels: as in `build_model`.
        adapter: as in `build_model`.
        workspace: as in `build_model`.
    """
    steps = case.solver.fine_steps_per_interval

    def on(some: PrismMesh) -> ForwardModel:
        return build_model(case, some, history, pixels, adapter, steps, workspace)

    divisions = case.specimen.divisions_of(len(mesh.faces["S_MINUS"]))
    size = size_between(case, divisions)
    return on(mesh) if size is None else extrapolated_with(on(mesh), on(mesh_of(case, size)))


def size_between(case: Case, divisions: int) -> float | None:
    """Size of the hexahedra with which finer ones are extrapolated [µm].

    None where that is done with the working mesh, and for tetrahedra.

    Args:
        case: the case.
        divisions: cells of the finer mesh along half of the longest side of the section, or pieces
            of each edge of a mesh of the user's own.
    """
    specimen = case.specimen
    working = specimen.divisions(specimen.mesh_size)
    return next_coarser(case, divisions) if _NEXT_COARSER * divisions >= working + 1 else None


def next_coarser(case: Case, divisions: int) -> float | None:
    """Size of the hexahedra with which smaller ones are extrapolated [µm].

    None for tetrahedra, and where there are none larger.

    Args:
        case: the case.
        divisions: of the smaller ones, as in `size_between`.
    """
    specimen, coarser = case.specimen, int(_NEXT_COARSER * divisions)
    if specimen.cell_kind != "hex20" or not coarser:
        return None
    return specimen.size_of(coarser)


def _boundary_motion(case: Case, mesh: PrismMesh, weights: FloatArray) -> BoundaryMotion:
    minus, plus = mesh.nodes["S_MINUS"], mesh.nodes["S_PLUS"]
    nodes = np.concatenate([minus, plus])
    mask = np.ones((nodes.size, 3), dtype=bool)
    if case.boundary.U_X == "free":
        # Y and Z are prescribed on both ends: only the translation along X is left to pin.
        mask[:, 0] = np.isin(nodes, mesh.nodes["P_MINUS"])
    return BoundaryMotion(
        nodes=nodes,
        side=np.repeat([-1.0, 1.0], [minus.size, plus.size]),
        zeta=-mesh.points[nodes, 2] / case.specimen.depth,
        across=mesh.points[nodes, 0] / (case.specimen.width / 2),
        weights=weights,
        mask=mask,
        terms=terms_of(BoundaryTerm),
    )
