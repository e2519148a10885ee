"""What is written of every identification, with images or from loads alone."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from driver.common.formatting import with_sigma
from driver.identification.fit import Fit
from driver.identification.identifiability import prior_shares, ruled_by_prior
from driver.identification.identify import Identification
from driver.identification.objective import Correction
from driver.parameters.pose import POSE_DECLARATIONS
from driver.results.files import HISTORY_JSON, IDENTIFY, IDENTIFY_CSV
from driver.results.hdf5 import write_csv, write_hdf5
from solver_adapters.parameter import Parameter

Arrays = dict[str, tuple[NDArray[np.generic] | float, str]]


def warnings_of(found: Identification) -> tuple[str, ...]:
    """Sentences on what the data did not decide, and on time steps that had to be cut."""
    parameters, final = found.objective.parameters, found.final
    bounds = [
        f"{name} stands at its bound {final.values[name]:g}: its interval ends there"
        for name in final.at_bounds(parameters)
    ]
    nuisances = {p.name for p in POSE_DECLARATIONS} | {"load_gain"}
    ruled = [rule.sentence() for rule in ruled_by_prior(final) if rule.name not in nuisances]
    return (*bounds, *ruled, *_cut_steps(found))


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
    told, unit = with_sigma(fit.values[name], fit.sigma(name, parameters)), parameters[name].unit
    return f"{name} = ({told}) {unit}" if unit else f"{name} = {told}"


def write_identification(
    folder: Path, found: Identification, start: Mapping[str, float], more: Arrays
) -> None:
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
    correction = found.objective.correction
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
