"""`prismid posterior`: draws from the posterior of the identified parameters beside their σ."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from shlex import quote
from time import perf_counter

import numpy as np

from driver.case.model import Case
from driver.case.scheduler import on_workers
from driver.common.errors import InputError, sentence
from driver.common.formatting import cost_told, duration
from driver.common.parallel import blas_on_one_thread, side_by_side
from driver.common.progress import quiet
from driver.forward.build import capabilities_of
from driver.forward.cost import simulation_memory, simulation_seconds, systems_of
from driver.identification.identify import corrected_with_derivatives
from driver.identification.line_search import newton
from driver.identification.objective import Evaluation, Objective
from driver.posterior.importance_sampling import proposals, weighted
from driver.posterior.moments import Sampled, lines_of, sampled
from driver.results.files import (
    IDENTIFY,
    POSTERIOR,
    POSTERIOR_DRAWS,
    results_of,
)
from driver.results.hdf5 import read_hdf5, write_csv
from driver.results.identification import read_identification
from driver.results.mesh_sizes import sized_case
from driver.workflow.cost import identified_images
from driver.workflow.engine import StageContext, StageError, finished
from driver.workflow.identify_stage import load_problem, same_simulation, saved_objective
from driver.workflow.pipeline import stages
from meshes.arrays import FloatArray
from solver_adapters.interface import SolverError
from solver_adapters.jobs.errors import is_by_circumstances
from solver_adapters.kernels import use_threads
from solver_adapters.parameter import Parameter

logger = logging.getLogger(__name__)

_AT_ONCE = 5  # draws of a task


@dataclass(frozen=True, eq=False)
class _Task:
    """Some draws to be simulated.

    Attributes:
        objective: whose simulations begin beside the optimum.
        at: evaluation at the optimum.
        values: every parameter of each draw.
    """

    objective: Objective
    at: Evaluation
    values: tuple[Mapping[str, float], ...]


@blas_on_one_thread()
def posterior(
    case_path: Path, draws: int = 300, seed: int = 0, results_folder: Path | None = None
) -> tuple[Sampled, ...]:
    """Sample the posterior of the identified parameters and write `posterior.csv`.

    Simulations are those of the working mesh with the correction of the identification; images
    count to first order about its result, so that only the model is not taken as linear.

    Args:
        case_path: the case file.
        draws: how many parameter sets are simulated.
        seed: of the draws.
        results_folder: folder of the results, None for that of the case.

    Raises:
        InputError: the case has no images or no finished identification, or arviz-stats is not
            installed.
        SolverError: a simulation was not run, or more than half of them failed.
    """
    case = sized_case(case_path, results_folder)
    _refuse_unready(case)
    context = StageContext(case, results_of(case), results_of(case))
    problem, identified = load_problem(context), read_hdf5(context.result(IDENTIFY))
    texts = read_identification(context.result(IDENTIFY))
    values = problem.objective.model.null_values() | texts.values
    use_threads(case.execution.processes * case.execution.threads)
    n_cells = len(problem.working.microstructure.mesh.cells)
    n_images = problem.experiment.history.n_images
    _foretell(case, n_cells, n_images, len(texts.names), draws)
    objective = saved_objective(problem, identified)
    at = same_simulation(objective, identified, values).evaluate(values, texts.names)
    objective, at = corrected_with_derivatives(objective, problem.finer, at, problem.plan.sizes)
    near = objective.with_time_steps_of(at).warm_started_from(at)
    step, decrement = newton(objective, at)
    logger.info(f"  the minimum of the cost is {decrement:.2g} σ from where the fit has ended")
    drawn = proposals(at.hessian, draws, seed, step)
    inside, sets = _sets(at, objective.parameters, drawn.theta)
    costs = np.full(draws, np.inf)
    with on_workers(case):
        costs[inside] = _costs(near, at, [sets[k] for k in inside], case)
    failed = int(np.isinf(costs[inside]).sum())
    if 2 * (draws - np.isfinite(costs).sum()) > draws:
        raise SolverError(
            f"posterior: found {failed} of {draws} draws that cannot be simulated and "
            f"{draws - len(inside)} beyond the bounds of the parameters, expected less than half: "
            "the data do not bound the parameters"
        )
    found = weighted(costs, drawn)
    table = tuple(sampled(name, at, objective.parameters, sets, found) for name in at.free)
    for line in lines_of(table, found, failed):
        logger.info(line)
    folder = results_of(case)
    columns = list(Sampled.__dataclass_fields__)
    write_csv(folder / POSTERIOR, {name: [getattr(p, name) for p in table] for name in columns})
    each = {name: [values[name] for values in sets] for name in at.free}
    of_draws = {"cost": costs.tolist(), "weight": found.weights.tolist()}
    write_csv(folder / POSTERIOR_DRAWS, each | of_draws)
    logger.info(f"{folder}: {POSTERIOR}, {POSTERIOR_DRAWS}")
    return table


def _refuse_unready(case: Case) -> None:
    if find_spec("arviz_stats") is None:
        expected = '`pip install "prismid[posterior]"` before'
        raise InputError(sentence(case.file, "posterior", "no arviz-stats", expected))
    if not case.with_images:
        expected = "a case with images"
        raise InputError(sentence(case.file, "boundary.motion", '"stage"', expected))
    needed = ("mesh", "measure", "identify")
    every = [stage for stage in stages(case) if stage.name in needed]
    if missing := [name for name in needed if name not in finished(case, every, ())]:
        found = f"no results of {', '.join(missing)} for the case as it is"
        expected = f"those of `prismid run {quote(str(case.file))} --until identify`"
        raise StageError(sentence(results_of(case), "folder", found, expected))


def _foretell(case: Case, n_cells: int, n_images: int, n_free: int, draws: int) -> None:
    """Tell what the simulations take."""
    solver, use = capabilities_of(case), case.execution
    first = simulation_seconds(case, solver, n_cells, n_images, n_free)
    others = draws * simulation_seconds(case, solver, n_cells, n_images) / use.processes
    of_steps = case.solver.steps_per_interval
    memory = simulation_memory(
        case.specimen.cell_kind, n_cells, n_images, n_free, of_steps, systems_of(case)
    )
    memory += identified_images(case, n_images)
    processes = 1 if use.scheduler is not None else 1 + use.processes
    logger.info(f"{draws} draws: {cost_told(first + others, processes * memory)}")


def _sets(
    at: Evaluation, parameters: Mapping[str, Parameter], theta: FloatArray
) -> tuple[list[int], list[dict[str, float]]]:
    """Return the numbers of the draws inside the bounds, and every parameter of each draw."""
    sets, inside = [], []
    for k, draw in enumerate(theta):
        new = dict(at.values)
        kept = True
        for name, moved in zip(at.free, draw.tolist(), strict=True):
            known, old = parameters[name], at.values[name]
            new[name] = known.value(moved, old)
            kept &= bool(np.isclose(known.theta(new[name], old), moved, rtol=1e-9, atol=1e-12))
        sets.append(new)
        if kept:
            inside.append(k)
    return inside, sets


def _costs(
    near: Objective, at: Evaluation, sets: Sequence[Mapping[str, float]], case: Case
) -> FloatArray:
    """Return ‖r‖² + prior of each draw, infinite where it cannot be simulated."""
    parts = [tuple(sets[k : k + _AT_ONCE]) for k in range(0, len(sets), _AT_ONCE)]
    tasks = [_Task(near, at, part) for part in parts]
    begun, ended = perf_counter(), 0

    def done(index: int, result: list[float]) -> None:
        nonlocal ended
        ended += len(result)
        left = (perf_counter() - begun) * (len(sets) / ended - 1)
        logger.info(f"  {ended} of {len(sets)} draws; {duration(left)} to go")

    use = case.execution
    ends = side_by_side(_simulated, tasks, use.processes, use.threads, done)
    return np.array([cost for part in ends for cost in part])


@quiet()
def _simulated(task: _Task) -> list[float]:
    costs = []
    for values in task.values:
        try:
            prediction = task.objective.model.predict(values, ())
        except SolverError as error:
            if is_by_circumstances(error):
                raise
            costs.append(np.inf)
            continue
        costs.append(task.objective.cost_about(task.at, prediction, values))
    return costs
