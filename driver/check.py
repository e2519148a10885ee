"""Looks at everything that a run needs, and draws it, before anything is computed."""

from __future__ import annotations

import platform
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, entry_points, requires, version
from pathlib import Path
from typing import Literal

import numpy as np

from driver.case import Case, load_case
from driver.check_picture import draw
from driver.diagnosis.causes import LIBRARY
from driver.errors import InputError
from driver.estimate import estimate
from driver.experiment import Experiment, read_experiment
from driver.images.heightmaps import ImageError, on_surface
from driver.profiles import profile_of
from driver.specimen import build_model, integration_of, mesh_of
from driver.stages import RESULTS
from meshes.prism import PrismGeometry, generate
from solver_adapters.external import ABSENT, ExternalAdapter
from solver_adapters.interface import Adapter, Capabilities, SolverError
from solver_adapters.profile import config_path
from solver_adapters.registry import find_adapter, takes_profile

SOLVERS = "prismid.solvers"
# Share of the measured face that may be at level 0 (a trench) before the origin is in doubt.
_TRENCH_SHARE = 0.05


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at.

    Attributes:
        level: "ok", "warning" (a run works, but look at it) or "error" (a run would stop).
        subject: what was looked at.
        message: what was found; of an error also what was expected.
    """

    level: Literal["ok", "warning", "error"]
    subject: str
    message: str


def check(case_path: Path) -> list[Finding]:
    """Check a case with its files, its solver and the libraries; draw `results/check.png`.

    Args:
        case_path: the case file.

    Returns:
        What was looked at, in the order of a run. Nothing is raised for bad input: it is found.
    """
    findings = list(_libraries())
    try:
        case = load_case(case_path)
    except InputError as error:
        return findings + [Finding("error", "case", line) for line in str(error).splitlines()]
    findings.append(Finding("ok", "case", f"{case_path} is valid"))
    findings += _orientation(case)
    findings += _causes(case)
    of_solver = list(_solver(case))
    findings += of_solver
    n_cells, mesh_finding = _mesh(case)
    findings.append(mesh_finding)
    try:
        experiment = read_experiment(case)
    except (InputError, ImageError) as error:
        return [*findings, Finding("error", "experiment", str(error))]
    findings += _history(case, experiment)
    findings += _images(case, experiment)
    if n_cells:
        make = solvers().get(case.solver.name)
        if make is not None:
            findings.append(_cost(case, make().capabilities(), n_cells, experiment))
            # What is wrong above would be told once more, in words for another reader.
            if all(finding.level != "error" for finding in of_solver):
                findings += _rendered(case, experiment)
    picture = case_path.parent / RESULTS / "check.png"
    picture.parent.mkdir(exist_ok=True)
    draw(case, experiment, picture)
    findings.append(Finding("ok", "picture", f"{picture}: ROI, axes, grain boundary, load curve"))
    return findings


def solvers() -> dict[str, Callable[..., Adapter]]:
    """The solver adapters that are installed, by name."""
    return {entry.name: entry.load() for entry in entry_points(group=SOLVERS)}


def _libraries() -> Iterator[Finding]:
    try:
        needed = requires("prismid") or []
    except PackageNotFoundError:
        yield Finding("error", "libraries", "prismid: found no installation, expected one by pip")
        return
    found = [f"Python {platform.python_version()}"]
    for requirement in needed:
        if "extra ==" in requirement:
            continue
        name = requirement.split(">=")[0].strip()
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            yield Finding("error", "libraries", f"{name}: found nothing, expected {requirement}")
    yield Finding("ok", "libraries", ", ".join(found))


def _orientation(case: Case) -> Iterator[Finding]:
    images = case.images
    yield Finding(
        "ok",
        "axes",
        f"rows along {images.rows_along}, columns along {images.columns_along}, heights along "
        f"{images.heights}: right-handed",
    )
    for grain, rotation in zip(case.grains, case.orientations, strict=True):
        along = " ".join(f"{component:+.3f}" for component in rotation[1])
        yield Finding("ok", "orientation", f"{grain.name}: loading axis along crystal [{along}]")


def _causes(case: Case) -> Iterator[Finding]:
    known = {cause.name for cause in LIBRARY}
    for name in case.diagnosis.causes if case.diagnosis.causes != "all" else ():
        if name not in known:
            expected = ", ".join(sorted(known))
            yield Finding(
                "error", "causes", f'diagnosis.causes: found "{name}", expected one of {expected}'
            )


def _solver(case: Case) -> Iterator[Finding]:
    available = solvers()
    name = case.solver.name
    if name not in available:
        known = ", ".join(sorted(available)) or "an adapter, but none is installed"
        yield Finding("error", "solver", f'solver.name: found "{name}", expected one of {known}')
        return
    try:
        profile = profile_of(case)
    except InputError as error:
        yield Finding("error", "solver", str(error))
        return
    make = available[name]
    adapter = make(profile) if takes_profile(make) else make()
    if adapter.version() == ABSENT:
        yield Finding(
            "warning",
            "solver",
            f"{name}: its program is not on this machine; expected it on PATH, or its call under "
            f"[solver.profiles.{name}] in the case or [profiles.{name}] in {config_path()} "
            "(`prismid run --prepare-only` writes the jobs for another machine)",
        )
    else:
        yield Finding("ok", "solver", f"{name} {adapter.version()}")
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
        integration_of(case, adapter)
    except InputError as error:
        yield Finding("error", "solver", str(error))
    for parameter in case.identification.parameters:
        if parameter not in capabilities.material:
            offered = ", ".join(sorted(capabilities.material))
            yield Finding(
                "error",
                "solver",
                f'identification.parameters: found "{parameter}", expected one that {name} '
                f"honours: {offered}",
            )


def _mesh(case: Case) -> tuple[int, Finding]:
    """Number of cells of the working mesh, 0 where there is none."""
    specimen = case.specimen
    try:
        mesh = generate(
            PrismGeometry(
                specimen.length,
                specimen.width,
                specimen.depth,
                specimen.boundary_point_um,
                specimen.boundary_normal,
            ),
            specimen.mesh_size,
        )
    except (ValueError, ImportError) as error:
        return 0, Finding("error", "mesh", f"specimen: {error}")
    grains = ", ".join(
        f"{name} {count}"
        for name, count in zip(
            [grain.name for grain in case.grains], np.bincount(mesh.grain), strict=True
        )
    )
    n_cells, n_nodes = len(mesh.cells), len(mesh.points)
    return n_cells, Finding("ok", "mesh", f"{n_cells} tet10 ({grains}), {n_nodes} nodes")


def _history(case: Case, experiment: Experiment) -> Iterator[Finding]:
    history = experiment.history
    cycles = int(history.cycle.max())
    yield Finding(
        "ok",
        "history",
        f"{history.n_images} images in {cycles} cycle(s), {history.time[-1]:g} s, stage travel to "
        f"{history.stage.max():g} µm, load to {experiment.force.max():.0f} µN",
    )
    held_out = case.diagnosis.held_out_cycle
    if isinstance(held_out, int) and held_out > cycles:
        yield Finding(
            "error",
            "history",
            f"diagnosis.held_out_cycle: found {held_out}, expected one of the {cycles} cycle(s)",
        )
    if held_out == "last" and cycles == 1:
        yield Finding("warning", "history", 'one cycle only: nothing is held out, as with "none"')


def _images(case: Case, experiment: Experiment) -> Iterator[Finding]:
    n_images, rows, columns = experiment.frames.shape
    yield Finding("ok", "images", f"{n_images} frames of {rows} × {columns} px")
    for name, what in (("flats", "no fixed pattern is removed"), ("repeats", "noise is nominal")):
        stack = getattr(experiment, name)
        if stack is None:
            yield Finding("warning", "images", f"images.{name} is not given: {what}")
        else:
            yield Finding("ok", "images", f"{len(stack)} {name}")
    (row, column), pixel = experiment.origin, experiment.pixel_um
    half, length = case.specimen.width / 2 / pixel, case.specimen.length / pixel
    top, bottom, left, right = row - half, row + half, column, column + length
    place = f"rows {top:.1f} … {bottom:.1f}, columns {left:.1f} … {right:.1f}"
    if top < -0.5 or left < -0.5 or bottom > rows - 0.5 or right > columns - 0.5:
        yield Finding(
            "error",
            "images",
            f"images.origin_pixel: found the measured face at {place}, expected it inside "
            f"{rows} × {columns} px",
        )
        return
    face = experiment.frames[
        0, round(max(top, 0)) : round(bottom) + 1, round(max(left, 0)) : round(right) + 1
    ]
    trench = 1.0 - on_surface(face).mean()
    if trench > _TRENCH_SHARE:
        yield Finding(
            "warning",
            "images",
            f"images.origin_pixel: {trench:.0%} of the measured face ({place}) is at level 0: "
            "look at the picture whether the face lies there",
        )
    else:
        yield Finding("ok", "images", f"measured face at {place}")


def _rendered(case: Case, experiment: Experiment) -> Iterator[Finding]:
    """What the solver refuses when its job is written."""
    try:
        adapter = find_adapter(case.solver.name, profile_of(case))
        if not isinstance(adapter, ExternalAdapter):
            return
        mesh = mesh_of(case, case.specimen.mesh_size)
        no_pixels, steps = np.zeros((0, 2)), case.solver.steps_per_interval
        model = build_model(case, mesh, experiment.history, no_pixels, adapter, steps)
        adapter.write(model.simulation(model.null_values()))
    except (InputError, SolverError) as error:
        yield Finding("error", "solver", str(error))


def _cost(case: Case, solver: Capabilities, n_cells: int, experiment: Experiment) -> Finding:
    stacks = (experiment.frames, experiment.flats, experiment.repeats)
    n_pixels = sum(stack.size for stack in stacks if stack is not None)
    cost = estimate(case, solver, n_cells, experiment.history.n_images, n_pixels)
    free = shutil.disk_usage(case.path(".")).free / 1e9
    return Finding(
        "ok",
        "cost",
        f"a run takes about {cost.seconds / 60:.1f} min ({cost.simulations} simulations on the "
        f"working mesh) and {cost.memory / 1e9:.1f} GB of memory; {free:.0f} GB of disk are free",
    )
