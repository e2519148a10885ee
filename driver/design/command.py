"""`prismid design`: from a case to what its experiment will say, before it is made."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from time import perf_counter

from driver.case.model import Case
from driver.case.scheduler import on_workers
from driver.common.atomic_write import write_whole
from driver.common.errors import InputError
from driver.common.formatting import cost_told
from driver.common.outcomes import first_line
from driver.common.parallel import blas_on_one_thread, side_by_side
from driver.design.forecast import (
    Forecast,
    Plan,
    Simulated,
    can_serve,
    forecast,
    prepare,
    simulate,
    whole_forecast,
)
from driver.design.picture import draw
from driver.design.record import design_of
from driver.design.schedule import changed
from driver.design.settings import Settings, read_change, read_settings
from driver.design.surface import Surface, expected_surface
from driver.design.text import lines_of
from driver.design.variants import base_variant, refuse_without_images, usual_changes, variants
from driver.diagnosis.causes.user_causes import asked_causes
from driver.experiment.history import History, read_history
from driver.experiment.log_file import HistoryError
from driver.forward.build import capabilities_of, mesh_of
from driver.forward.cost import simulation_seconds
from driver.identification.correction_cost import correction_seconds
from driver.report.style import png
from driver.results.design import write_design
from driver.results.files import DESIGN, DESIGN_PICTURE, job_store, make_folder, results_of
from driver.results.mesh_sizes import sized_case
from driver.virtual.truth import stage_program
from solver_adapters.interface import SolverError
from solver_adapters.kernels import use_threads

logger = logging.getLogger(__name__)

_DIRECTIONS = 90  # of boundary, law and all causes, in round numbers
_PROCESS_BYTES = 300e6
# Numbers that are held at a time for each pixel of each image.
_COPIES = 60


@blas_on_one_thread()
def design(
    case_path: Path,
    settings_path: Path | None,
    changes: Sequence[str],
    usual: bool,
) -> None:
    """Say what an experiment will say, and what changes of it would buy.

    Args:
        case_path: the case; images and loads need not exist, its history only where the settings
            give no cycles.
        settings_path: what is assumed, or None for the defaults.
        changes: keys of the case or of `test` with other values, a comparison for each.
        usual: whether the usual changes are compared, too.

    Raises:
        InputError: the case, a setting or a change cannot be used.
        SolverError: the experiment of the case could not be simulated.
    """
    case = sized_case(case_path)
    refuse_without_images(case)
    asked_causes(case)
    settings = Settings() if settings_path is None else read_settings(settings_path)
    history = _history(case, settings)
    surface = expected_surface(case, settings, history)
    if settings.test.repeats is not None:
        surface = replace(surface, images=surface.with_noise(1.0, settings.test.repeats))
    results = results_of(case)
    base = Plan(base_variant(case, settings), history, surface, settings, job_store(case))
    asked = variants(
        base.variant,
        usual_changes(case, settings.test, surface.images.n_reference) if usual else {},
        settings.what_if,
        [read_change(text) for text in changes],
        settings_path or case_path,
    )
    plans = [replace(base, variant=variant) for variant in asked]
    own = [plan for plan in plans if not plan.variant.simulated_as(base.variant)]
    make_folder(results, case.file)
    seconds, memory = _cost(base, own)
    logger.info(
        f"the case and {len(plans)} changes: {1 + len(own)} of them simulated with all "
        f"sensitivities, and once more on the finer mesh; {cost_told(seconds, memory)}"
    )
    use_threads(case.execution.processes * case.execution.threads)
    logger.info("the experiment of the case")
    prepared = prepare(base)
    simulated = simulate(prepared)
    before = forecast(prepared, simulated)
    logger.info(f"  simulated, {len(simulated.names)} sensitivities")
    with on_workers(base.variant.case):
        others = changed_forecasts(plans, base, simulated)
    for line in lines_of(before, surface.told, others):
        logger.info(line)
    _write(results, before, surface, others)
    logger.info(f"{results}: {DESIGN}, {DESIGN_PICTURE}")


def changed_forecasts(plans: Sequence[Plan], base: Plan, simulated: Simulated) -> list[Forecast]:
    """Forecasts of the changed experiments; those that need a simulation, side by side."""
    forecasts: dict[int, Forecast] = {}
    for number, plan in enumerate(plans):
        if plan.variant.simulated_as(base.variant):
            own = prepare(plan)
            if can_serve(simulated, own):
                forecasts[number] = forecast(own, simulated)
    alone = [number for number in range(len(plans)) if number not in forecasts]
    execution = base.variant.case.execution
    if alone:
        logger.info(f"{len(alone)} changed experiments, {execution.processes} at a time")
    start, ended = perf_counter(), 0

    def done(index: int, result: Forecast | str) -> None:
        nonlocal ended
        ended += 1
        name = plans[alone[index]].variant.name
        outcome = f"failed: {result}" if isinstance(result, str) else "simulated"
        left = (perf_counter() - start) * (len(alone) / ended - 1)
        logger.info(f"  {ended} of {len(alone)}, {name}: {outcome}; {left:.0f} s to go")

    asked = [plans[number] for number in alone]
    ends = side_by_side(_attempt, asked, execution.processes, execution.threads, done)
    forecasts |= {n: end for n, end in zip(alone, ends, strict=True) if isinstance(end, Forecast)}
    return [forecasts[number] for number in sorted(forecasts)]


def _attempt(plan: Plan) -> Forecast | str:
    """Return the forecast of a change, or why there is none: the others are still worth having.

    Also where a job was killed: a change has a row of its own, and nothing else hangs on it.
    """
    try:
        return whole_forecast(plan)
    except (SolverError, InputError) as error:
        return first_line(error)


def _history(case: Case, settings: Settings) -> History:
    if settings.program.cycles:
        return stage_program(settings.program.cycles)
    try:
        return read_history(case.path(case.history.file), with_loads=False, stated=case.history)
    except HistoryError as error:
        raise HistoryError(
            f"{error}; or `cycles` under [program] of --settings, where no test is planned yet"
        ) from None


def _cost(base: Plan, own: Sequence[Plan]) -> tuple[float, float]:
    """Seconds and bytes, roughly."""
    execution = base.variant.case.execution
    images = [changed(p.history, p.variant.test).n_images for p in (base, *own)]
    each = [_seconds(p.variant.case, n) for p, n in zip((base, *own), images, strict=True)]
    wall = each[0] + sum(each[1:]) / min(execution.processes, max(len(own), 1))
    pixels = len(base.surface.images.xy)
    bytes_each = _PROCESS_BYTES + 8.0 * _COPIES * pixels * max(images)
    return wall, bytes_each * (1 + min(execution.processes, len(own)))


def _seconds(case: Case, n_images: int) -> float:
    solver, specimen = capabilities_of(case), case.specimen
    n_cells, size = len(mesh_of(case, specimen.mesh_size).cells), specimen.fine_mesh_size
    working = simulation_seconds(case, solver, n_cells, n_images, _DIRECTIONS)
    return working + correction_seconds(case, solver, n_cells, n_images, size, (_DIRECTIONS,))


def _write(folder: Path, base: Forecast, surface: Surface, others: Sequence[Forecast]) -> None:
    write_design(folder, design_of(base, surface.told, surface.images.sigma, others))
    write_whole(folder / DESIGN_PICTURE, png(draw(base, others)))
