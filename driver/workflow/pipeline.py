"""The stages of a run: mesh → measure → identify → diagnose → advise → report."""

from __future__ import annotations

import logging
import os
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from shlex import quote

from driver.case.file_names import TRACE
from driver.case.model import Case
from driver.case.scheduler import on_workers
from driver.case.solver_profiles import profile_of
from driver.case.specimen import SIZES
from driver.common.errors import sentence
from driver.common.formatting import cost_told, joined
from driver.common.remaining import foretold
from driver.diagnosis.causes.user_causes import asked_causes
from driver.doubts.before_run import warnings_before_run
from driver.experiment.held_out import held_out_cycle
from driver.experiment.history import travel_told
from driver.experiment.reading import history_of, refuse_absent_images
from driver.forward.build import capabilities_of, mesh_of, refuse_unfit_solver
from driver.results.files import DIAGNOSIS, IDENTIFY, job_store, make_job_store, results_of
from driver.results.mesh_sizes import sized, sized_case
from driver.workflow.cost import Cost, estimate, measuring_memory
from driver.workflow.diagnose_stage import run_diagnose
from driver.workflow.drawing_stages import (
    run_advise,
    run_measure,
    run_report,
    run_report_identified,
    run_report_loads,
)
from driver.workflow.engine import (
    Stage,
    StageError,
    diagnosed_files,
    finished,
    identified_files,
    measured_files,
    meshed_files,
    reported_files,
    run_stages,
)
from driver.workflow.identify_stage import run_identify
from driver.workflow.loads_only_stage import SKIPPED, run_identify_loads
from driver.workflow.mesh_stage import run_mesh
from driver.workflow.refinement import coarser_again, refined_within_budget, told_beforehand
from solver_adapters.kernels import use_threads

logger = logging.getLogger(__name__)

_SIMULATING = ("identify", "diagnose")
_MESH = ("specimen",)
_OF_MAP = ("grains", "orientation")
"""Sections that place grains as an EBSD map shows them."""
_NO_PLACE = {"orientation": ("ebsd_frame",)}
"""What of them says where no grain lies."""
_MEASURE = ("specimen", "images", "history", "dic", "sections", "loads")
_IDENTIFY = (
    "grains", "orientation", "material", "boundary", "solver", "identification", "extensions",
)  # fmt: skip
_REPORT = (*_MESH, *_MEASURE, *_IDENTIFY, "diagnosis")


def _unseen(case: Case) -> Sequence[str]:
    """Return keys of the specimen of which a measurement knows nothing."""
    of_working_mesh = () if TRACE in (case.dic.mesh, case.dic.height_mesh) else ("cells", SIZES[0])
    return (*of_working_mesh, SIZES[1])


def stages(case: Case) -> Sequence[Stage]:
    """All stages of a case, in their order; without images nothing is measured or diagnosed."""
    of_map: tuple[str, ...] = _OF_MAP if case.labelled_by_map else ()
    of_image: tuple[str, ...] = () if case.specimen.labels is None or of_map else ("images",)
    meshed, measured = (*_MESH, *of_map, *of_image), (*_MEASURE, *of_map)
    if not case.with_images:
        inputs = (*meshed, "history", "sections", "loads", *_IDENTIFY)
        return (
            Stage("mesh", "3", meshed, run_mesh, meshed_files, _NO_PLACE),
            Stage("identify", "13", inputs, run_identify_loads, identified_files),
            Stage("report", "4", inputs, run_report_loads, reported_files),
        )
    return (
        Stage("mesh", "3", meshed, run_mesh, meshed_files, _NO_PLACE),
        Stage(
            "measure",
            "11",
            measured,
            run_measure,
            measured_files,
            {"specimen": _unseen(case), **_NO_PLACE},
            alone=True,
            reads_on=True,
        ),
        Stage("identify", "18", (*_MESH, *_MEASURE, *_IDENTIFY), run_identify, identified_files),
        Stage("diagnose", "28", ("diagnosis",), run_diagnose, diagnosed_files),
        Stage("advise", "1", (), run_advise),
        Stage("report", "11", _REPORT, run_report, reported_files),
    )


def run(
    case_path: Path,
    until: str | None = None,
    force: bool = False,
    prepare_only: bool = False,
    processes: int | None = None,
    threads: int | None = None,
    store: Path | None = None,
    results: Path | None = None,
) -> None:
    """Run the stages of a case; what is done and unchanged is not done again.

    Meshes of automatic sizes are refined, and what hangs on them is done again, as long as the
    diagnosis asks for it and the budget of time holds it. Where they cannot be simulated the run
    ends with what the meshes before came to.

    Args:
        case_path: the case file.
        until: name of the last stage to run, None for all.
        force: run the stages even if they are done and unchanged.
        prepare_only: whether external solvers write their jobs for another machine.
        processes: simulations side by side, None for those of the case.
        threads: threads of each process, None for those of the case.
        store: folder of the jobs of a solver that is a program of its own, None for that of the
            case.
        results: folder of the results, None for that of the case.

    Raises:
        PreparedError: jobs were written for another machine, which `prepare_only` asks for.
        InputError: the case or a measured file cannot be used.
        SolverError: a simulation could not be finished.
    """
    case = _executed(sized_case(case_path, results), processes, threads)
    if store is not None:
        case = case.with_values_at({"execution.store": os.path.abspath(store)})
    solver = capabilities_of(case)
    if prepare_only and solver.in_process:
        raise StageError(
            f'--prepare-only: found solver.name = "{case.solver.name}", which runs inside prismid, '
            "expected a solver that is a program of its own"
        )
    asked_causes(case)  # refused before hours of computing, not after
    if case.with_images and until != "mesh":
        refuse_absent_images(case)
    use_threads(case.execution.processes * case.execution.threads)
    mesh, history = mesh_of(case, case.specimen.mesh_size), history_of(case)
    if solver.uses_workspace and case.execution.store is not None:
        make_job_store(job_store(case), case.file)
    # Asked now, and not after the hours of the stages before the simulations.
    refuse_unfit_solver(case, mesh, history)
    if case.with_images:
        held_out_cycle(case, history)
    logger.info(travel_told(history))
    cost = estimate(case, solver, len(mesh.cells), history.n_images)
    every = stages(case)
    left = _left(case, every, until, force)
    _foretell(case, cost, left, history.n_images)
    if case.specimen.refined is not None and "diagnose" in left:
        logger.info(told_beforehand(case, cost))
    if not case.with_images:
        logger.info(SKIPPED)
    if left:
        for finding in warnings_before_run(case, history):
            logger.info(f"WARNING: {finding.subject}: {finding.message}")
    foreseen = {name: cost.of([name]) for name in left}
    with foretold(foreseen, _SIMULATING) as remaining, on_workers(case) if left else nullcontext():

        def refined(state: Case, done: str) -> Case | None:
            finer = refined_within_budget(state, done, stages=every)
            if finer is not None:
                of_finer = _cost_as_it_is(finer)
                again = _left(finer, every, until, force=False)
                remaining.foreseen = {name: of_finer.of([name]) for name in again}
            return finer

        run_stages(case, every, until, force, prepare_only, refined, coarser_again)


def _left(case: Case, every: Sequence[Stage], until: str | None, force: bool) -> list[str]:
    """Return the stages that are asked for and not done, by name."""
    names = [stage.name for stage in every]
    asked = names[: names.index(until) + 1] if until in names else names
    done = frozenset[str]() if force else finished(case, every, ())
    return [name for name in asked if name not in done]


def _foretell(case: Case, cost: Cost, left: Sequence[str], n_images: int) -> None:
    """Tell what the stages take that are left."""
    if not left:
        logger.info("all stages that are asked for are done")
        return
    measuring = measuring_memory(case, n_images) if case.with_images else cost.memory
    simulates = any(name in left for name in _SIMULATING)
    memory = cost.memory if simulates or not case.with_images else measuring
    whole = len(left) == len(stages(case))
    seconds = cost.of(left)
    told = cost_told(seconds, memory) if seconds else "a minute at most"
    logger.info(f"all stages take {told}" if whole else f"{joined(left)}: {told}")
    if case.with_images and simulates and "measure" in left:
        logger.info(f"those up to measure take {measuring / 1e9:.1f} GB of memory")


def cost_of_run(case: Case, processes: int, threads: int, n_images: int = 0) -> Cost:
    """Return what all stages of a case take.

    Args:
        case: the case.
        processes: simulations side by side.
        threads: threads of each process.
        n_images: images of a history that is not there yet, 0 for those of the case.

    Raises:
        InputError: the case cannot be meshed or computed.
    """
    sizes = sized(case, capabilities_of(case))
    return _cost_as_it_is(_executed(sizes, processes, threads), n_images)


def cores_of_run(case: Case, processes: int, threads: int) -> int:
    """Return the cores that a run of a case takes at a time.

    A solver that is a program of its own has for each of its jobs those of its profile.

    Args:
        case: the case.
        processes: simulations side by side.
        threads: threads of each process.

    Raises:
        ConfigError: the user's configuration cannot be used.
        ConsentError: the case states a command to which the user has not agreed.
    """
    if capabilities_of(case).in_process:
        return processes * threads
    profile = profile_of(case)
    return processes * max(threads, profile.processes * profile.threads)


def _cost_as_it_is(case: Case, n_images: int = 0) -> Cost:
    """Return what all stages of a case with sizes in numbers take."""
    mesh = mesh_of(case, case.specimen.mesh_size)
    n_images = n_images or history_of(case).n_images
    return estimate(case, capabilities_of(case), len(mesh.cells), n_images)


def _executed(case: Case, processes: int | None, threads: int | None) -> Case:
    """Return a case with another use of the machine, as far as one is asked for."""
    asked = {"processes": processes, "threads": threads}
    stated = {f"execution.{key}": n for key, n in asked.items() if n is not None}
    return case.with_values_at(stated)


def report(case_path: Path, results: Path | None = None, vectors: Path | None = None) -> None:
    """Write the report page anew from the results that are there, identified or diagnosed.

    Args:
        case_path: the case file.
        results: folder of the results, None for that of the case.
        vectors: a folder for the figures as PDF and SVG files, None for none.

    Raises:
        StageError: a stage before it has no results, or such as are of another state of the case;
            or the figures cannot be written.
    """
    case = sized_case(case_path, results)
    every = stages(case)
    *before, last = every
    write = run_report if case.with_images else run_report_loads
    folder = results_of(case)
    needed = folder / (DIAGNOSIS if case.with_images else IDENTIFY)
    if not needed.is_file():
        if not (folder / IDENTIFY).is_file():
            run = f"`prismid run {quote(str(case_path))}`"
            raise StageError(sentence(needed, "file", "nothing", f"the results of {run}"))
        write = run_report_identified
        before = before[: [stage.name for stage in every].index("identify") + 1]
        last = replace(last, run=write)
    if vectors is not None:
        if vectors.exists() and not vectors.is_dir():
            raise StageError(sentence(vectors, "--figures", "a file", "a folder, or nothing yet"))
        last = replace(last, run=lambda context: write(context, vectors))
    finished(case, (*before, last), [stage.name for stage in before])
    run_stages(case, [last], None, True)
