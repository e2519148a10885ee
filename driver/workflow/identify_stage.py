"""Stage 3: boundary motion and parameters of the law, with their uncertainty."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from driver.case.model import Case, CaseError
from driver.common.errors import sentence
from driver.experiment.history import History
from driver.identification.identify import identify, with_correction
from driver.identification.measured_slip import slip_of_images
from driver.identification.objective import Evaluation, Objective
from driver.identification.problem import IdentificationProblem, build_problem, seen_by_correlation
from driver.identification.travel_ratio import travel_ratio
from driver.parameters.boundary import LAMBDAS, elongation_names
from driver.results.files import FINE_MESH, MEASURE, MESH, job_store
from driver.results.hdf5 import read_hdf5
from driver.results.identification import (
    value_told,
    warnings_of,
    write_with_images,
    written_correction,
    written_jitter,
    written_noise_factor,
    written_trajectory,
)
from driver.results.kept_responses import keeping
from driver.workflow.engine import StageContext
from driver.workflow.prepared_images import prepared_images
from meshes.arrays import FloatArray
from meshes.files import read_med

logger = logging.getLogger(__name__)


def load_problem(context: StageContext) -> IdentificationProblem:
    """Return the problem of a case from the results of the first two stages."""
    measured, prepared = read_hdf5(context.result(MEASURE)), prepared_images(context)
    left_out = tuple(map(int, np.flatnonzero(measured["left_out"])))
    return build_problem(
        context.case,
        read_med(context.result(MESH)),
        read_med(context.result(FINE_MESH)),
        seen_by_correlation(
            prepared.experiment,
            prepared.images.rescaled(measured["gain"]),
            measured["motion"],
            measured["elongation"],
            measured["tilt"],
            left_out,
        ),
        job_store(context.case),
        partial(keeping, folder=context.kept),
        context.prepare_only,
    )


def run_identify(context: StageContext) -> None:
    """Identify, and write parameters, covariance, budget and predictions."""
    problem = load_problem(context)
    refuse_large_jitter(
        context.case, problem.plan.jitter, problem.start, problem.experiment.history
    )
    identification = identify(
        problem.working, problem.finer, problem.objective, problem.start, problem.plan
    )  # fmt: skip
    final = identification.final
    measured = read_hdf5(context.result(MEASURE))
    budget = error_budget(problem, final.best, measured["chi"])
    for name in (n for n in (*LAMBDAS, *problem.law) if n in final.best.free):
        logger.info(f"  {value_told(name, final, problem.objective.parameters)}")
    for warning in warnings_of(identification):
        logger.info(f"  {warning}")
    ratio = travel_ratio(final, problem.objective.parameters, problem.experiment.history)
    if ratio is not None:
        logger.info(f"  {ratio.sentence()}")
    logger.info(
        f"  budget: noise 1, free correlation {budget['free']:.2f}, "
        f"this model {budget['model']:.2f} (images), {budget['load']:.2f} (loads)"
    )
    slip = slip_of_images(
        context.case,
        problem,
        identification.objective.data,
        measured["coefficients"],
        measured["residual"],
    )
    write_with_images(context.workdir, identification, problem, budget, slip)


def refuse_large_jitter(
    case: Case, jitter: float, start: Mapping[str, float], history: History
) -> None:
    """Refuse a noise of the boundary motion that is larger than the mean travel between stops.

    The answer to it is linear (`driver.identification.boundary_jitter`): beyond, it would turn
    loading into unloading.

    Args:
        case: the case.
        jitter: σ_e [µm].
        start: every parameter where the identification starts, knots as correlation found them.
        history: the history.

    Raises:
        CaseError: it is larger than the mean of that travel.
    """
    knots = [0.0, *(start[name] for name in elongation_names(history.n_knots))]
    travel = float(np.abs(np.diff(knots)).sum()) / (history.n_images - 1)
    if jitter > travel:
        expected = f"well below {1e3 * travel:.2g}, the mean elongation from one stop to the next"
        found = f"{1e3 * jitter:g}"
        raise CaseError(sentence(case.file, "boundary.jitter_nm", found, expected))


def error_budget(
    problem: IdentificationProblem, best: Evaluation, free_chi: FloatArray
) -> dict[str, float]:
    """χ at pixel level from noise over free correlation to the model, and χ_F of the loads.

    Images that are not fitted do not count.
    """
    images = problem.images
    data = problem.objective.data
    seen = data.with_image
    motion = best.motion[data.index] + np.einsum("tr,rpc->tpc", best.shift, data.image.rigid)
    variance = images.expected_residual_variance(motion)
    return {
        "noise": 1.0,
        "free": float(np.sqrt(np.mean(free_chi[data.index[seen]] ** 2))),
        "model": float(np.sqrt(np.mean((best.rho**2 / variance)[seen]))),
        "basis": best.chi_image,
        "load": best.chi_load,
    }


def saved_objective(problem: IdentificationProblem, results: dict[str, FloatArray]) -> Objective:
    """Return the objective of the last stage of a finished identification."""
    objective = problem.objective
    if (jitter := written_jitter(results)) is not None:
        objective = replace(objective, data=replace(objective.data, jitter=jitter))
    factor, correction = written_noise_factor(results), written_correction(results)
    return with_correction(objective, factor, correction, problem.plan.sizes)


def same_simulation(
    objective: Objective, results: dict[str, FloatArray], values: Mapping[str, float]
) -> Objective:
    """Return the objective in the steps of a finished identification, started by its trajectory.

    Args:
        objective: that of its last stage.
        results: what was written of it.
        values: every parameter as it was identified.
    """
    trajectory = written_trajectory(results)
    if trajectory is None:  # of a solver that does not tell it
        return objective
    model = objective.model.with_time_steps_of(trajectory.times[1:], values).warm_started_from(
        trajectory, values
    )
    return replace(objective, model=model)
