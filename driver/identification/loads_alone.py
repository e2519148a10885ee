"""The law from the loads alone, where the elongation is known from the stage travel.

The knots are free with the stage travel as their prior: the loads fix what they are sharper in,
which is every elastic unloading. The correction of the simulation is that of the loads.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from driver.identification.fit import Correction, Objective, fit
from driver.identification.identifiability import refuse_what_is_not_seen
from driver.identification.procedure import (
    START,
    Identification,
    Plan,
    elastic_stiffness,
    unload_elastically,
)
from driver.identification.simulation_error import SimulationError, share_left
from driver.model import ForwardModel

Log = Callable[[str], None]


def identify_from_loads(
    objective: Objective,
    finer: ForwardModel,
    start: Mapping[str, float],
    plan: Plan,
    log: Log,
) -> Identification:
    """Fit the law and the elongation, correct the simulation, and fit again with the λ's.

    Args:
        objective: data without images, and priors, those of the knots among them.
        finer: finer mesh and steps, for the correction.
        start: every parameter at the start.
        plan: which parameters are free, and how it is run.
        log: takes one line of progress.

    Returns:
        Stages B, without the correction, and C, with it and with free λ's.

    Raises:
        SolverError: the model cannot be evaluated at the start.
        InputError: loads and priors leave a combination of parameters open.
    """
    model, data = objective.model, objective.data
    stiffness = elastic_stiffness(model, start)
    log(f"the law from the loads; elastic stiffness {1e-3 * stiffness:.1f} µN/nm")
    weights = model.boundary.weights[model.image_row]
    begin = unload_elastically(start, stiffness, weights, data.load)
    first = fit(objective, begin, plan.free("B"), plan.most, log, share=START)
    log("finer mesh and steps at the result, for the correction")
    change = finer.predict(first.values).load - first.best.prediction.load
    log(f"  finer − working: load {np.sqrt(np.mean(change**2)):.2f} µN rms")
    left = share_left(plan.sizes[1] / plan.sizes[0]) * change
    error = SimulationError(np.zeros((left.size, 0)), np.zeros((0, 0)), left)
    corrected = replace(
        objective,
        data=replace(data, simulation_error=error),
        correction=Correction(0.0, change),
    )
    log("all together, with the correction")
    last = fit(corrected, first.values, plan.free("C"), plan.most, log)
    refuse_what_is_not_seen(last.best)
    return Identification(corrected, {"B": first, "C": last}, plan.law)
