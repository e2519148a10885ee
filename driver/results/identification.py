"""What is written of every identification, with images or from loads alone."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import astuple, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from driver.common.formatting import with_sigma
from driver.experiment.history import History
from driver.identification.boundary_jitter import BoundaryJitter
from driver.identification.correction import Correction
from driver.identification.fit import Fit
from driver.identification.identifiability import far_off_told, prior_shares, ruled_by_prior
from driver.identification.identify import Identification
from driver.identification.kinematic_hessian import kinematic_hessian
from driver.identification.measured_slip import MeasuredSlip
from driver.identification.problem import IdentificationProblem
from driver.identification.slip_activity import SlipActivity, slip_activity
from driver.identification.step_error import StepError
from driver.identification.travel_ratio import TravelRatio, travel_ratio
from driver.parameters.boundary import LAMBDAS
from driver.parameters.pose import POSE_DECLARATIONS
from driver.results.files import HISTORY_JSON, IDENTIFY, IDENTIFY_CSV
from driver.results.hdf5 import damaged, read_attributes, write_csv, write_hdf5
from meshes.arrays import FloatArray
from solver_adapters.interface import Trajectory
from solver_adapters.parameter import Parameter

Arrays = dict[str, tuple[NDArray[np.generic] | float, str]]


def warnings_of(found: Identification) -> tuple[str, ...]:
    """Sentences on what the data did not decide or contradict, and on steps that were cut."""
    parameters, final = found.objective.parameters, found.final
    bounds = [
        f"{parameters[name].title} stands at its bound {final.values[name]:g}: "
        "its interval ends there"
        for name in final.at_bounds(parameters)
    ]
    nuisances = {p.name for p in POSE_DECLARATIONS} | {"load_gain"}
    ruled = [rule.sentence() for rule in ruled_by_prior(final) if rule.name not in nuisances]
    return (*bounds, *ruled, *far_off_told(final), *_cut_steps(found))


def _cut_steps(found: Identification) -> tuple[str, ...]:
    """Return a sentence where the solver took other time steps than those that were asked for."""
    response = found.final.best.prediction.response
    cuts = found.objective.model.cut_steps(response)
    if not cuts:
        return ()
    return (
        f"{response.ends.size} time steps were taken, {cuts} more than stated, for some did not "
        "converge and were cut: their error is not that of the steps stated; more "
        "steps_per_interval in [solver] make it smaller",
    )


def _left_by_steps(correction: Correction) -> Arrays:
    """Return what time steps of first order leave wrong, where there are such."""
    left = correction.left_by_steps
    if left is None:
        return {}
    return {
        "correction/steps_motion": (left.motion, "µm"),
        "correction/steps_load": (left.load, "µN"),
    }


def value_told(name: str, fit: Fit, parameters: Mapping[str, Parameter]) -> str:
    """Return a value with its uncertainty, the digits that this leaves, and its unit."""
    text, unit = with_sigma(fit.values[name], fit.sigma(name, parameters)), parameters[name].unit
    return f"{name} = ({text}) {unit}" if unit else f"{name} = {text}"


def _write(folder: Path, found: Identification, start: Mapping[str, float], more: Arrays) -> None:
    """Write `identify.h5`, `identify.csv` and `identify_history.json`.

    Args:
        folder: where they go.
        found: the identification.
        start: every parameter at the start of the case.
        more: datasets beside those of the parameters, with their units.
    """
    final, parameters = found.final, found.objective.parameters
    names = final.best.free
    units = [parameters[name].unit for name in names]
    values = np.array([final.values[name] for name in names])
    sigma = np.array([final.sigma(name, parameters) for name in names])
    covariance = final.covariance
    deviation = np.sqrt(np.diag(covariance))
    none = (np.nan, np.inf)
    prior = np.array([found.objective.prior.get(name, none) for name in names])
    correction = found.objective.correction.at(found.final.values)
    write_hdf5(
        folder / IDENTIFY,
        {
            "values": (values, "see units"),
            "sigma": (sigma, "see units"),
            "start": (np.array([start[name] for name in names]), "see units"),
            "covariance": (covariance, "of θ"),
            "correlation": (covariance / np.outer(deviation, deviation), "1"),
            "prior/mean": (prior[:, 0], "see units"),
            "prior/width": (prior[:, 1], "of θ"),
            "prior_share": (prior_shares(final.best), "1"),
            "initial/load": (next(iter(found.stages.values())).start_load, "µN"),
            "correction/load": (np.asarray(correction.load), "µN"),
            "correction/parts": (float(correction.parts), "1"),
            **_left_by_steps(correction),
            **_histories(found),
            **more,
        },
        {
            "names": json.dumps(names),
            "units": json.dumps(units),
            "all_values": json.dumps(final.values),
            "reason": final.reason,
            "converged": "yes" if final.converged else "",
            "warnings": json.dumps(warnings_of(found), ensure_ascii=False),
        },
    )
    write_csv(
        folder / IDENTIFY_CSV,
        {
            "parameter": list(names),
            "value": values.tolist(),
            "sigma": sigma.tolist(),
            "unit": units,
            "model": ["identified"] * len(names),
        },
    )
    record = {
        stage: {"reason": fit.reason, "seconds": round(fit.seconds, 2), "iterations": fit.history}
        for stage, fit in found.stages.items()
    }
    (folder / HISTORY_JSON).write_text(json.dumps(record, indent=1), encoding="utf-8")


def _histories(found: Identification) -> Arrays:
    """Parameters and χ after each iteration of each stage."""
    parameters = found.objective.parameters
    return {
        f"history/{stage}/{key}": (
            np.array([record[key] for record in fit.history]),
            parameters[key].unit if key in parameters else "1",
        )
        for stage, fit in found.stages.items()
        for key in fit.history[0]
    }


def fit_arrays(fit: Fit, problem: IdentificationProblem, prefix: str) -> Arrays:
    """Predictions and residuals of a fit for the results file."""
    best, data = fit.best, problem.objective.data
    return {
        f"{prefix}/load": (best.load, "µN"),
        f"{prefix}/load_residual": (data.load - best.load, "µN"),
        f"{prefix}/motion": (best.motion.astype(np.float32), "µm"),
        f"{prefix}/rho": (best.rho.astype(np.float32), "µm"),
    }


def _as_in_the_paper(found: Identification) -> Arrays:
    """Figure 12a, and χ, χ_f, χ_F of tables 4 and 5 at the start of stage A and at the end."""
    objective, final = found.objective, found.final
    model = objective.model
    names = tuple(dict.fromkeys((*LAMBDAS, *filter(model.simulated, found.law))))
    whole = objective.with_free(final.best, names)
    first, last = found.stages["A"].history[0], final.history[-1]
    return {
        "kinematic_hessian": (kinematic_hessian(objective, whole, names), "of log p"),
        "hessian_names": (np.array(names, dtype="S"), ""),
        **{
            f"paper/{key}": (np.array([first[f"paper_{key}"], last[f"paper_{key}"]]), "1")
            for key in ("chi", "chi_f", "chi_F")
        },
    }


def _starts(found: Identification) -> Arrays:
    """Where each start ended; NaN where it failed."""
    if not found.starts:
        return {}
    return {
        "starts/cost": (np.array([outcome.cost for outcome in found.starts]), "1"),
        **{
            f"starts/{name}": (
                np.array([outcome.values.get(name, np.nan) for outcome in found.starts]),
                found.objective.parameters[name].unit,
            )
            for name in found.law
        },
    }


def _trajectory(trajectory: Trajectory | None, of: str = "trajectory") -> Arrays:
    """By which the simulation can be repeated without its iterations, or with few."""
    if trajectory is None:
        return {}
    return {
        f"{of}/times": (trajectory.times, "s"),
        f"{of}/displacement": (trajectory.displacement, "µm"),
    }


def written_trajectory(datasets: Mapping[str, FloatArray]) -> Trajectory | None:
    """Return the trajectory of an identification, None of a solver that does not tell it.

    Args:
        datasets: those of `identify.h5` by name.
    """
    return _written(datasets, "trajectory")


def _written(datasets: Mapping[str, FloatArray], of: str) -> Trajectory | None:
    if f"{of}/times" not in datasets:
        return None
    return Trajectory(datasets[f"{of}/times"], datasets[f"{of}/displacement"])


def slip_arrays(slip: SlipActivity | None) -> Arrays:
    """Return the datasets of the slips of a model, none of a solver that tells none."""
    if slip is None:
        return {}
    return {
        "slip/images": (slip.images, "1"),
        "slip/grains": (slip.of_grains, "1"),
        "slip/cells": (slip.of_cells, "1"),
    }


def written_slip(datasets: Mapping[str, FloatArray]) -> SlipActivity | None:
    """Return the slips of a model, None where none were told.

    Args:
        datasets: those of `identify.h5` or `diagnosis.h5` by name.
    """
    if "slip/cells" not in datasets:
        return None
    images = datasets["slip/images"].astype(np.int64)
    return SlipActivity(images, datasets["slip/grains"], datasets["slip/cells"])


def _measured_slip(slip: MeasuredSlip) -> Arrays:
    return {
        "measured_slip/image": (float(slip.image), "1"),
        "measured_slip/strain": (slip.strain, "1"),
        "measured_slip/strain_sigma": (slip.strain_sigma, "1"),
        "measured_slip/elastic": (slip.elastic, "1"),
        "measured_slip/slip": (slip.slip, "1"),
        "measured_slip/sigma": (slip.sigma, "1"),
        "measured_slip/without": (slip.without, "1"),
        "measured_slip/total": (slip.total, "1"),
    }


def written_measured_slip(datasets: Mapping[str, FloatArray]) -> MeasuredSlip | None:
    """Return the slips that the images tell, None of an identification that has not sought them.

    Args:
        datasets: those of `identify.h5` by name.
    """
    if "measured_slip/total" not in datasets:
        return None
    return MeasuredSlip(
        int(datasets["measured_slip/image"]),
        *(
            datasets[f"measured_slip/{name}"]
            for name in ("strain", "strain_sigma", "elastic", "slip", "sigma", "without", "total")
        ),
    )


def _travel_ratio(ratio: TravelRatio | None) -> Arrays:
    return {} if ratio is None else {"travel_ratio": (np.array(astuple(ratio)), "1")}


def _jitter(jitter: BoundaryJitter | None) -> Arrays:
    if jitter is None:
        return {}
    return {
        "jitter/load": (jitter.load, "µN"),
        "jitter/image": (jitter.image.astype(np.float32), "1"),
    }


def written_jitter(datasets: Mapping[str, FloatArray]) -> BoundaryJitter | None:
    """Return what noise of the boundary did in an identification, None where it had none.

    Args:
        datasets: those of `identify.h5` by name.
    """
    if "jitter/load" not in datasets:
        return None
    return BoundaryJitter(datasets["jitter/load"], datasets["jitter/image"])


def written_noise_factor(datasets: Mapping[str, FloatArray]) -> float:
    """Return the noise on the correlation basis over that of the repeats.

    Args:
        datasets: those of `identify.h5` by name.
    """
    return float(datasets["noise_factor"])


def written_correction(datasets: Mapping[str, FloatArray]) -> Correction:
    """Return the correction of an identification.

    Args:
        datasets: those of `identify.h5` by name.
    """
    left = None
    if "correction/steps_load" in datasets:
        left = StepError(datasets["correction/steps_motion"], datasets["correction/steps_load"])
    return Correction(
        datasets["correction/motion"],
        datasets["correction/load"],
        left,
        int(datasets["correction/parts"]),
        course=_written(datasets, "finer_trajectory"),
    )


@dataclass(frozen=True)
class IdentificationTexts:
    """What `identify.h5` says in words.

    Attributes:
        names: free parameters.
        units: unit of each.
        values: value of every parameter of the general model.
        warnings: sentences on what the data did not decide.
        reason: why the last fit ended.
        converged: whether it converged.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: dict[str, float]
    warnings: tuple[str, ...]
    reason: str
    converged: bool


def read_identification(path: Path) -> IdentificationTexts:
    """Read the words of `identify.h5` back.

    Raises:
        ResultError: the file cannot be read, or an attribute is absent or no readable JSON.
    """
    attributes = read_attributes(path)
    for name in ("names", "units", "all_values", "warnings", "reason", "converged"):
        if name not in attributes:
            raise damaged(path, f"no attribute {name}")
    try:
        names, units, values, warnings = (
            json.loads(attributes[name]) for name in ("names", "units", "all_values", "warnings")
        )
        if len(names) != len(units):
            raise ValueError(f"{len(units)} units of {len(names)} parameters")
        return IdentificationTexts(
            tuple(map(str, names)),
            tuple(map(str, units)),
            {str(name): float(value) for name, value in values.items()},
            tuple(map(str, warnings)),
            str(attributes["reason"]),
            bool(attributes["converged"]),
        )
    except (TypeError, ValueError, AttributeError, RecursionError) as error:
        raise damaged(path, f"no readable parameters ({error})") from None


def write_fits(
    path: Path,
    fits: Mapping[str, Fit],
    problem: IdentificationProblem,
    slip: SlipActivity | None,
) -> None:
    """Write predictions and residuals of some fits.

    Args:
        path: file to write.
        fits: by the name that stands before their datasets.
        problem: what they started from.
        slip: of the last of them.
    """
    datasets: Arrays = slip_arrays(slip)
    for name, fit in fits.items():
        datasets |= fit_arrays(fit, problem, name)
    write_hdf5(path, datasets)


def write_with_images(
    folder: Path,
    found: Identification,
    problem: IdentificationProblem,
    budget: Mapping[str, float],
    measured_slip: MeasuredSlip,
) -> None:
    """Write the results of an identification by images and loads.

    Args:
        folder: where they go.
        found: the identification.
        problem: what it started from.
        budget: the error budget, by name.
        measured_slip: what the images alone tell of the slips.
    """
    correction = found.objective.correction.at(found.final.values)
    history = problem.experiment.history
    _write(
        folder,
        found,
        problem.start,
        {
            "correction/motion": (np.asarray(correction.motion), "µm"),
            **slip_arrays(slip_activity(found.objective.model, found.final)),
            **_measured_slip(measured_slip),
            **_travel_ratio(travel_ratio(found.final, found.objective.parameters, history)),
            "noise_factor": (found.objective.data.image.noise_factor, "1"),
            **{f"budget/{key}": (value, "1") for key, value in budget.items()},
            **_as_in_the_paper(found),
            **_starts(found),
            **_jitter(found.objective.data.jitter),
            **_trajectory(found.final.best.prediction.response.trajectory),
            **_trajectory(correction.course, "finer_trajectory"),
            **fit_arrays(found.final, problem, "final"),
        },
    )


def write_of_loads(
    folder: Path, found: Identification, start: Mapping[str, float], history: History
) -> None:
    """Write the results of an identification by loads alone.

    Args:
        folder: where they go.
        found: the identification.
        start: every parameter at the start of the case.
        history: of the test.
    """
    best, load = found.final.best, found.objective.data.load
    _write(
        folder,
        found,
        start,
        {
            "time": (history.time[history.image_row], "s"),
            "stage": (history.stage[history.image_row], "µm"),
            "cycle": (history.cycle, "1"),
            "force": (load, "µN"),
            "budget/noise": (1.0, "1"),
            "budget/load": (best.chi_load, "1"),
            "final/load": (best.load, "µN"),
            "final/load_residual": (load - best.load, "µN"),
        },
    )
