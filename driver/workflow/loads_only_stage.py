"""The identification of a case without images: from its loads and the travel of the stage."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from functools import partial

import numpy as np

from driver.case.model import Case
from driver.experiment.history import History
from driver.experiment.reading import history_of
from driver.forward.boundary_motion import knots_of_stage
from driver.forward.build import (
    adapter_of,
    build_finer_model,
    build_model,
    capabilities_of,
)
from driver.forward.cost import foreseen_seconds
from driver.forward.model import ForwardModel
from driver.forward.progress_adapter import ProgressAdapter
from driver.identification.data import Data
from driver.identification.identify import Plan
from driver.identification.loads_alone import doubts, identify_from_loads
from driver.identification.no_images import no_images
from driver.identification.objective import Objective
from driver.identification.problem import law_of, stated_prior, stated_start
from driver.parameters.boundary import elongation_names
from driver.results.files import FINE_MESH, MESH, job_store
from driver.results.identification import value_told, warnings_of, write_of_loads
from driver.results.kept_responses import keeping
from driver.workflow.engine import StageContext
from meshes.files import read_med
from solver_adapters.interface import Adapter

logger = logging.getLogger(__name__)

SKIPPED = 'measure, diagnose and advise are left out: boundary.motion = "stage" has no images'


@dataclass(frozen=True, eq=False)
class LoadsProblem:
    """Models, data and starts of a case without images.

    Attributes:
        history: times, stage travel and loads.
        finer: finer mesh and steps.
        objective: working model, data and priors; no correction yet.
        start: every parameter at the start.
        plan: which parameters are free, and how the identification is run.
    """

    history: History
    finer: ForwardModel
    objective: Objective
    start: dict[str, float]
    plan: Plan


def build_loads_problem(context: StageContext, adapter: Adapter) -> LoadsProblem:
    """Put a case without images together from the results of the first stage.

    Raises:
        HistoryError: the history cannot be used.
    """
    case, no_pixels = context.case, np.zeros((0, 2))
    history = history_of(case)
    jobs = job_store(case) if capabilities_of(case).uses_workspace else None
    mesh, fine_mesh = (read_med(context.result(name)) for name in (MESH, FINE_MESH))
    steps = case.solver.steps_per_interval
    working = build_model(case, mesh, history, no_pixels, adapter, steps, jobs)
    finer = build_finer_model(case, fine_mesh, history, no_pixels, adapter, jobs)
    parameters = working.parameters
    knots = elongation_names(history.n_knots)
    travel = history.stage[history.turning]
    along, deviation = knots_of_stage(travel, *_stated_ratio(case))
    start = stated_start(
        case, working.null_values() | dict(zip(knots, along.tolist(), strict=True))
    )
    prior = stated_prior(case, start, working, history.n_images, 0)
    prior |= {
        name: (start[name], sigma / parameters[name].scale)
        for name, sigma in zip(knots, deviation.tolist(), strict=True)
    }
    data = Data(
        no_images(history.n_images),
        history.force * case.force_scale,
        case.loads.gamma_F,
        case.loads.autocorrelation,
        np.arange(history.n_images),
        stated_bad_loads=case.loads.left_out,
    )
    objective = Objective(working, data, parameters, prior)
    plan = Plan(
        law=law_of(case),
        knots=knots,
        sizes=(case.specimen.mesh_size, case.specimen.fine_mesh_size),
        most=case.identification.max_iterations,
    )
    return LoadsProblem(history, finer, objective, start, plan)


def _stated_ratio(case: Case) -> tuple[float, float]:
    ratio, deviation = case.boundary.stage_ratio, case.boundary.stage_ratio_uncertainty
    assert ratio is not None and deviation is not None  # the case refuses itself without them
    return ratio, deviation


def run_identify_loads(context: StageContext) -> None:
    """Identify from the loads, and write parameters, covariance and predictions."""
    case = context.case
    solver = keeping(adapter_of(case, context.prepare_only), context.kept)
    adapter = ProgressAdapter(solver, partial(foreseen_seconds, case, solver.capabilities()))
    problem = build_loads_problem(context, adapter)
    identification = identify_from_loads(
        problem.objective, problem.finer, problem.start, problem.plan
    )  # fmt: skip
    final, history = identification.final, problem.history
    for name in problem.plan.law:
        logger.info(f"  {value_told(name, final, problem.objective.parameters)}")
    for warning in warnings_of(identification):
        logger.info(f"  {warning}")
    n_loads, chi = problem.objective.data.n_load, final.best.chi_load
    logger.info(f"  budget: noise 1, this model {chi:.2f} (loads)")
    for sentence in doubts(chi, n_loads, final.converged):
        logger.info(f"  WARNING: {sentence}")
    write_of_loads(context.workdir, identification, problem.start, history)
