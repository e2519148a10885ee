"""Looks at everything that a run needs, and draws it, before anything is computed."""

from __future__ import annotations

import platform
import shutil
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path

import numpy as np

from driver.case.consent import refuse_unless_agreed
from driver.case.model import Case, load_case
from driver.case.scheduler import client_of, requests_of_scheduler
from driver.case.solver_profiles import profile_of
from driver.case.specimen import SIZES
from driver.check.ebsd_picture import map_pictures
from driver.check.images import look_at_images
from driver.check.picture import draw
from driver.check.steps import recommended_steps
from driver.common import machine
from driver.common.errors import InputError, sentence, why
from driver.common.formatting import cost_told
from driver.diagnosis.causes.user_causes import asked_causes
from driver.dic.region import within
from driver.doubts.finding import Finding
from driver.doubts.loads import stated_motion, strange_loads
from driver.doubts.orientations import look_at_orientations
from driver.doubts.plausible import in_figures
from driver.experiment.held_out import held_out_cycle
from driver.experiment.history import History, travel_told
from driver.experiment.map_labels import map_on_face, share_without_grain
from driver.experiment.orientations import map_files, orientations_of
from driver.experiment.reading import Experiment, fitted_loads, history_of, read_experiment
from driver.forward.build import (
    build_model,
    correlation_meshes,
    integration_of,
    mesh_of,
    refuse_parameters,
    refuse_size,
    used_face,
)
from driver.forward.geometry import grain_places
from driver.report.style import boundaries_label
from driver.results.extended_decks import rendered_decks
from driver.results.files import (
    CHECK_PICTURE,
    job_store,
    make_folder,
    make_job_store,
    results_of,
    with_results,
)
from driver.results.mesh_sizes import sized
from driver.results.stage_record import refuse_another_case
from driver.workflow.cost import estimate
from driver.workflow.refinement import told_beforehand
from meshes.arrays import FloatArray
from meshes.cells import NAMES
from meshes.plane_mesh import PlaneMesh
from solver_adapters.external import ABSENT, ExternalAdapter
from solver_adapters.interface import Adapter, Capabilities, SolverError
from solver_adapters.profile import config_path
from solver_adapters.registry import find_adapter

_MUCH_UNTOLD = 0.1  # of the face, without a grain in the map that places them


def check(case_path: Path, results: Path | None = None) -> list[Finding]:
    """Check a case with its files, its solver and the libraries; draw `results/check.png`.

    Args:
        case_path: the case file.
        results: folder of the results, None for that of the case.

    Returns:
        What was looked at, in the order of a run. Nothing is raised for bad input: it is found.
    """
    findings = list(_libraries())
    try:
        case = with_results(load_case(case_path), results)
    except InputError as error:
        return findings + [Finding("error", "case", line) for line in str(error).splitlines()]
    findings.append(Finding("ok", "case", f"{case_path} is valid"))
    findings += _axes(case)
    of_grains = look_at_orientations(case)
    findings += of_grains
    unoriented = any(finding.level == "error" for finding in of_grains)
    findings += _causes(case)
    findings += _scheduler(case)
    adapter: Adapter | None = None
    try:
        adapter = find_adapter(case.solver.name, profile_of(case))
    except (InputError, SolverError) as error:
        findings.append(Finding("error", "solver", str(error)))
    try:
        case = sized(case, None if adapter is None else adapter.capabilities())
    except InputError as error:
        return [*findings, Finding("error", "mesh", str(error))]
    of_solver = [] if adapter is None else list(_solver(case, adapter))
    findings += of_solver
    n_cells, mesh_finding = _mesh(case)
    unplaced = case.labelled_by_map and not n_cells
    if not (unplaced and unoriented):
        findings.append(mesh_finding)
    if case.labelled_by_map and n_cells:
        findings.append(_told_by_map(case))
    if not case.with_images:
        return [*findings, *_loads_alone(case, adapter, n_cells, unoriented)]
    findings += _correlation(case)
    try:
        experiment = read_experiment(case)
    except InputError as error:
        lines = str(error).splitlines()
        return [*findings, *(Finding("error", "experiment", line) for line in lines)]
    findings += _history(case, experiment, unoriented)
    # What is wrong above would be told once more, in words for another reader.
    refused = unoriented or any(finding.level == "error" for finding in of_solver)
    if adapter is not None and not refused:
        findings += recommended_steps(case, adapter, experiment.history)
    seen, reference = look_at_images(case, experiment)
    findings += seen
    if n_cells and adapter is not None:
        n_images = experiment.history.n_images
        findings += _cost(case, adapter.capabilities(), n_cells, n_images)
        if not refused:
            findings += _decks(case, adapter, experiment)
    if unplaced:  # without lines to draw
        return findings
    picture = results_of(case) / CHECK_PICTURE
    try:
        refuse_another_case(picture.parent, case)
        make_folder(picture.parent, case.file)
        codes = None if reference is None else reference.codes
        maps, rotations = ((), None) if unoriented else (map_pictures(case), orientations_of(case))
        draw(case, experiment, picture, codes, maps, rotations)
    except OSError as error:
        expected = "a folder that can be made and written"
        message = sentence(picture.parent, "folder", why(error), expected)
        return [*findings, Finding("error", "picture", message)]
    except InputError as error:
        return [*findings, Finding("error", "picture", str(error))]
    boundaries = len(case.grains) - 1
    drawn = ["ROI", "pixels left out", "axes", "load curve"]
    drawn += [boundaries_label(boundaries)] if boundaries else []
    drawn += ["slip traces"] if rotations is not None and grain_places(case) else []
    drawn += ["EBSD map"] if map_files(case) and not unoriented else []
    findings.append(Finding("ok", "picture", f"{picture}: {', '.join(drawn)}"))
    return findings


def _libraries() -> Iterator[Finding]:
    try:
        needed = requires("prismid") or []
    except PackageNotFoundError:
        yield Finding("error", "libraries", "prismid: found no installation, expected one by pip")
        return
    versions = [f"Python {platform.python_version()}"]
    for requirement in needed:
        if "extra ==" in requirement:
            continue
        name = requirement.split(">=")[0].strip()
        try:
            versions.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            yield Finding("error", "libraries", f"{name}: found nothing, expected {requirement}")
    yield Finding("ok", "libraries", ", ".join(versions))


def _axes(case: Case) -> Iterator[Finding]:
    images = case.images
    yield Finding(
        "ok",
        "axes",
        f"rows along {images.rows_along}, columns along {images.columns_along}, heights along "
        f"{images.heights}: right-handed",
    )


def _scheduler(case: Case) -> Iterator[Finding]:
    address = case.execution.scheduler
    if address is None:
        return
    try:
        refuse_unless_agreed(case.file, requests_of_scheduler(case))
        with client_of(address, case.file) as client:
            threads = client.nthreads().values()
    except InputError as error:
        yield Finding("error", "scheduler", str(error))
        return
    told = f"{address}: {len(threads)} worker(s), {sum(threads)} thread(s), of which at most "
    told += f"execution.processes = {case.execution.processes} are used at a time"
    yield Finding("ok", "scheduler", told)


def _causes(case: Case) -> Iterator[Finding]:
    try:
        asked_causes(case)
    except InputError as error:
        for line in str(error).splitlines():
            yield Finding("error", "causes", line)


def _solver(case: Case, adapter: Adapter) -> Iterator[Finding]:
    name = case.solver.name
    try:
        version = adapter.version()
    except SolverError as error:
        # A program that is there and cannot start.
        yield Finding("error", "solver", str(error))
        return
    if adapter.capabilities().uses_workspace and case.execution.store is not None:
        store = job_store(case)
        try:
            make_job_store(store, case.file)
            yield Finding("ok", "store", f"{store} holds the jobs of {name}")
        except InputError as error:
            yield Finding("error", "store", str(error))
    if version == ABSENT:
        yield Finding(
            "warning",
            "solver",
            f"{name}: its program is not on this machine{_stated(case)}; expected it on PATH, or "
            f"its call under [solver.profiles.{name}] in the case or [profiles.{name}] in "
            f"{config_path()} "
            "(`prismid run --prepare-only` writes the jobs for another machine)",
        )
    else:
        yield Finding("ok", "solver", version if version.startswith(name) else f"{name} {version}")
    capabilities = adapter.capabilities()
    measure = case.material.strain_measure
    if measure not in capabilities.strain_measures:
        offered = ", ".join(sorted(capabilities.strain_measures))
        yield Finding(
            "error",
            "solver",
            f'material.strain_measure: found "{measure}", expected one that {name} offers: '
            f"{offered}",
        )
    elif measure in capabilities.cautions:
        yield Finding("warning", "solver", capabilities.cautions[measure])
    try:
        integration_of(case, adapter.capabilities())
    except InputError as error:
        yield Finding("error", "solver", str(error))
    try:
        refuse_parameters(case, capabilities)
    except InputError as error:
        for line in str(error).splitlines():
            yield Finding("error", "solver", line)


def _stated(case: Case) -> str:
    """Return the call that a profile states and that cannot be made, in words."""
    command = profile_of(case).command
    if not command:
        return ""
    return f' (found no program "{command[0]}" that can be run; arguments are words of their own)'


def _mesh(case: Case) -> tuple[int, Finding]:
    """Return the number of cells of the working mesh, 0 where there is none."""
    specimen = case.specimen
    try:
        for key, size in zip(SIZES, (specimen.mesh_size, specimen.fine_mesh_size), strict=True):
            refuse_size(case, key, size)
        mesh = mesh_of(case, specimen.mesh_size)
    except (InputError, ImportError) as error:
        return 0, Finding("error", "mesh", str(error))
    grains = ", ".join(
        f"{name} {count}"
        for name, count in zip(
            [grain.name for grain in case.grains], np.bincount(mesh.grain), strict=True
        )
    )
    n_cells, n_nodes = len(mesh.cells), len(mesh.points)
    kind = NAMES[mesh.cells.shape[1]]
    return n_cells, Finding("ok", "mesh", f"{n_cells} {kind} ({grains}), {n_nodes} nodes")


def _told_by_map(case: Case) -> Finding:
    """Say how much of the face the EBSD map that places the grains tells."""
    share = share_without_grain(map_on_face(case))
    text = (
        f"specimen.labels: {100.0 * share:.2g} % of the face has no grain in the map and goes to "
        "the nearest one"
    )
    if share > _MUCH_UNTOLD:
        expected = f"at most {100.0 * _MUCH_UNTOLD:g} %, along boundaries"
        return Finding("warning", "mesh", f"{text}; expected {expected}")
    return Finding("ok", "mesh", text)


def _correlation(case: Case) -> Iterator[Finding]:
    """Yield the meshes of correlation that are no regular grids."""
    try:
        meshes = correlation_meshes(case)
        within([mesh for mesh in meshes if isinstance(mesh, PlaneMesh)], used_face(case))
    except InputError as error:
        yield Finding("error", "dic", str(error))
        return
    for key, mesh in zip(("mesh", "height_mesh"), meshes, strict=True):
        if isinstance(mesh, PlaneMesh):
            size = mesh.size / case.images.pixel_um
            yield Finding("ok", "dic", f"dic.{key}: {len(mesh.cells)} {mesh.kind} of {size:.1f} px")


def _loads_alone(
    case: Case, adapter: Adapter | None, n_cells: int, unoriented: bool
) -> Iterator[Finding]:
    """Yield what a run from loads alone needs."""
    try:
        history = history_of(case)
    except InputError as error:
        yield Finding("error", "history", str(error))
        return
    force = history.force * case.force_scale
    yield _course(case, history, force, "loads")
    yield Finding("ok", "stage", travel_told(history))
    if not unoriented:
        yield from in_figures(case, history, force)
    yield from strange_loads(case, history, force)
    yield stated_motion(case, history)
    if adapter is not None and not unoriented:
        yield from recommended_steps(case, adapter, history)
    yield Finding("ok", "images", 'not used, for boundary.motion is "stage": no picture is drawn')
    if n_cells and adapter is not None:
        yield from _cost(case, adapter.capabilities(), n_cells, history.n_images)


def _course(case: Case, history: History, force: FloatArray, what: str) -> Finding:
    force, left = fitted_loads(case, force), len(case.loads.left_out)
    out = f", {left} load(s) left out" if left else ""
    return Finding(
        "ok",
        "history",
        f"{history.n_images} {what} in {history.cycle.max()} cycle(s), {np.ptp(history.time):g} s, "
        f"stage travel to {history.stage.max():g} µm, load to {np.nanmax(force):.0f} µN "
        f"({np.nanmax(force) / case.section:.0f} MPa){out}",
    )


def _history(case: Case, experiment: Experiment, unoriented: bool) -> Iterator[Finding]:
    history = experiment.history
    yield _course(case, history, experiment.force, "images")
    yield Finding("ok", "stage", travel_told(history))
    if not unoriented:
        yield from in_figures(case, history, experiment.force)
    yield from strange_loads(case, history, experiment.force)
    try:
        held_out_cycle(case, history)
    except InputError as error:
        yield Finding("error", "history", str(error))
    if case.diagnosis.held_out_cycle == "last" and history.cycle.max() == 1:
        yield Finding("warning", "history", 'one cycle only: nothing is held out, as with "none"')


def _decks(case: Case, adapter: Adapter, experiment: Experiment) -> Iterator[Finding]:
    """Which solvers that are programs of their own can take the model of the case, and why not."""
    try:
        mesh = mesh_of(case, case.specimen.mesh_size)
        no_pixels, steps = np.zeros((0, 2)), case.solver.steps_per_interval
        model = build_model(case, mesh, experiment.history, no_pixels, adapter, steps)
        values = model.null_values()
        if isinstance(adapter, ExternalAdapter):
            adapter.files(model.simulation(values))
        decks = rendered_decks(case, model, values)
    except (InputError, SolverError) as error:
        yield Finding("error", "solver", str(error))
        return
    for name, deck in decks.items():
        if isinstance(deck, str):
            yield Finding("ok", "decks", f"no deck of this model for {name}: {deck}")
        else:
            yield Finding("ok", "decks", f"{name} can take this model as a deck")


def _cost(case: Case, solver: Capabilities, n_cells: int, n_images: int) -> Iterator[Finding]:
    cost = estimate(case, solver, n_cells, n_images)
    free = shutil.disk_usage(case.path(".")).free / 1e9
    there, short = machine.memory(), ""
    if cost.memory > there:
        short = (
            f", but this machine has {there / 1e9:.3g} GB: take larger elements or fewer processes"
        )
    yield Finding(
        "warning" if short else "ok",
        "cost",
        f"a run takes {cost_told(cost.seconds, cost.memory)} ({cost.simulations} simulations on "
        f"the working mesh){short}; {free:.0f} GB of disk are free",
    )
    if case.specimen.refined is not None:
        yield Finding("ok", "cost", told_beforehand(case, cost))
