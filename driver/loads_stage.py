"""The identification of a case without images: from its loads and the travel of the stage."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from driver.boundary import LAMBDAS, elongation_names, knots_of_stage
from driver.case import Case
from driver.experiment import history_of
from driver.history import History
from driver.identification.data import Data
from driver.identification.fit import Fit, Objective
from driver.identification.loads_alone import LoadsFit, doubts, identify_from_loads
from driver.identification.no_images import no_images
from driver.identification.priors import prior_of
from driver.identify_stage import (
    HISTORY_JSON,
    IDENTIFY,
    IDENTIFY_CSV,
    JOBS,
    told_at_bounds,
    value_told,
)
from driver.log import passing_of
from driver.mesh_stage import FINE_MESH, MESH
from driver.model import ForwardModel
from driver.results import write_csv, write_hdf5
from driver.specimen import adapter_of, build_model
from driver.stages import StageContext
from driver.watched_solver import WatchedSolver
from driver.workbench import BUNDLED, law_of, load_uncertainties
from meshes.files import read_med
from solver_adapters.interface import Adapter
from solver_adapters.parameter import Parameter

FloatArray = NDArray[np.float64]
Prior = dict[str, tuple[float, float]]

SKIPPED = 'measure and diagnose are left out: boundary.motion = "stage" has no images'


@dataclass(frozen=True, eq=False)
class LoadsBench:
    """Models, data and starts of a case without images.

    Attributes:
        history: times, stage travel and loads.
        finer: finer mesh and steps.
        objective: working model, data and priors; no correction yet.
        start: every parameter at the start.
        law: names of the free parameters of law, load cell and extensions.
        knots: names of the elongation knots.
    """

    history: History
    finer: ForwardModel
    objective: Objective
    start: dict[str, float]
    law: tuple[str, ...]
    knots: tuple[str, ...]


def build_loads_bench(context: StageContext, adapter: Adapter) -> LoadsBench:
    """Put a case without images together from the results of the first stage.

    Raises:
        HistoryError: the history cannot be used.
    """
    case, no_pixels = context.case, np.zeros((0, 2))
    history = history_of(case)
    jobs: Path | None = None if case.solver.name == BUNDLED else context.results / JOBS
    steps = case.solver.steps_per_interval, case.solver.fine_steps_per_interval
    working, finer = (
        build_model(case, read_med(context.result(name)), history, no_pixels, adapter, n, jobs)
        for name, n in zip((MESH, FINE_MESH), steps, strict=True)
    )
    parameters = working.parameters
    knots = elongation_names(history.n_knots)
    along, deviation = knots_of_stage(
        history.stage[history.turning], *_stated_ratio(case)
    )  # fmt: skip
    table = case.boundary.lambda_start
    amplitudes = (table.plus_Y, table.plus_Z, table.minus_Y, table.minus_Z)
    null = working.null_values()
    start = null | dict(zip(LAMBDAS, amplitudes, strict=True)) | case.extensions
    start |= dict(zip(knots, along.tolist(), strict=True))
    prior = _priors(case, start, null, parameters, history.n_images)
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
    )
    objective = Objective(working, data, parameters, prior)
    return LoadsBench(history, finer, objective, start, law_of(case), knots)


def _stated_ratio(case: Case) -> tuple[float, float]:
    ratio, deviation = case.boundary.stage_ratio, case.boundary.stage_ratio_uncertainty
    assert ratio is not None and deviation is not None  # the case refuses itself without them
    return ratio, deviation


def _priors(
    case: Case,
    start: dict[str, float],
    null: dict[str, float],
    parameters: dict[str, Parameter],
    n_loads: int,
) -> Prior:
    """Mean (value) and standard deviation (in θ) of all but the knots."""
    prior = prior_of(case.identification, start, parameters, n_loads, 0)
    for name in case.extensions:
        parameter = parameters[name]
        prior[name] = (null[name], parameter.scale if parameter.logarithmic else 1.0)
    stated = load_uncertainties(case)
    return prior | {name: (0.0, u / parameters[name].scale) for name, u in stated.items()}


def run_identify_loads(context: StageContext) -> None:
    """Identify from the loads, and write parameters, covariance and predictions."""
    case = context.case
    adapter = WatchedSolver(adapter_of(case, context.prepare_only), passing_of(context.log))
    bench = build_loads_bench(context, adapter)
    found = identify_from_loads(
        bench.objective, bench.finer, bench.start, bench.law, bench.knots,
        (case.specimen.mesh_size, case.specimen.fine_mesh_size),
        case.identification.max_iterations, context.log,
    )  # fmt: skip
    final, parameters = found.final, bench.objective.parameters
    told = prior_shares(final)
    for name in bench.law:
        context.log(f"  {value_told(name, final, parameters)}{_held(told.get(name))}")
    for sentence in told_at_bounds(final, parameters):
        context.log(f"  {sentence}")
    chi = final.best.chi_load
    context.log(f"  budget: noise 1, this model {chi:.2f} (loads)")
    for sentence in doubts(chi, bench.history.n_images, final.converged):
        context.log(f"  WARNING: {sentence}")
    _write(context, bench, found)


def prior_shares(fit: Fit) -> dict[str, float]:
    """Standard deviation after the fit over that of the prior, of each parameter with a prior."""
    deviation, weight = np.sqrt(np.diag(fit.covariance)), fit.best.prior_weight
    return {
        name: float(s * np.sqrt(w))
        for name, s, w in zip(fit.best.free, deviation, weight, strict=True)
        if w
    }


def _held(share: float | None) -> str:
    if share is None or share < 0.9:
        return ""
    return f" (the loads hardly tell: {100 * share:.0f} % of the width of its prior is left)"


def _write(context: StageContext, bench: LoadsBench, found: LoadsFit) -> None:
    final, parameters, history = found.final, bench.objective.parameters, bench.history
    best, rows = final.best, history.image_row
    names, covariance = best.free, final.covariance
    deviation = np.sqrt(np.diag(covariance))
    sigma = np.array([final.sigma(name, parameters) for name in names])
    values = np.array([final.values[name] for name in names])
    measured, shares = found.objective.data.load, prior_shares(final)
    write_hdf5(
        context.workdir / IDENTIFY,
        {
            "time": (history.time[rows], "s"),
            "stage": (history.stage[rows], "µm"),
            "cycle": (history.cycle, "1"),
            "force": (measured, "µN"),
            "values": (values, "see units"),
            "sigma": (sigma, "see units"),
            "start": (np.array([bench.start[name] for name in names]), "see units"),
            "prior_share": (np.array([shares.get(name, 0.0) for name in names]), "1"),
            "covariance": (covariance, "of θ"),
            "correlation": (covariance / np.outer(deviation, deviation), "1"),
            "correction/load": (np.asarray(found.objective.correction.load), "µN"),
            "budget/noise": (1.0, "1"),
            "budget/load": (best.chi_load, "1"),
            "initial/load": (found.stages["B"].start_load, "µN"),
            "final/load": (best.load, "µN"),
            "final/load_residual": (measured - best.load, "µN"),
        },
        {
            "names": json.dumps(names),
            "units": json.dumps([parameters[name].unit for name in names]),
            "all_values": json.dumps(final.values),
            "reason": final.reason,
            "converged": "yes" if final.converged else "",
        },
    )
    write_csv(
        context.workdir / IDENTIFY_CSV,
        {
            "parameter": list(names),
            "value": values.tolist(),
            "sigma": sigma.tolist(),
            "unit": [parameters[name].unit for name in names],
        },
    )
    record = {stage: {"reason": fit.reason, "iterations": fit.history}
              for stage, fit in found.stages.items()}  # fmt: skip
    (context.workdir / HISTORY_JSON).write_text(json.dumps(record, indent=1), encoding="utf-8")
