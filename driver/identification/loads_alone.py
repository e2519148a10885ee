"""The law from the loads alone, where the elongation is known from the stage travel.

The knots are free with the stage travel as their prior: the loads fix what they are sharper in,
which is every elastic unloading. The correction of the simulation is that of the loads.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from driver.boundary import LAMBDAS
from driver.identification.fit import Correction, Fit, Objective, fit
from driver.identification.procedure import START, elastic_stiffness, unload_elastically
from driver.identification.simulation_error import SimulationError, share_left
from driver.model import ForwardModel

FloatArray = NDArray[np.float64]
Log = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class LoadsFit:
    """Result of an identification without images.

    Attributes:
        objective: data, priors and the correction of the last fit.
        stages: the fits by name: B without, C with the correction and with free λ's.
    """

    objective: Objective
    stages: Mapping[str, Fit]

    @property
    def final(self) -> Fit:
        """The last fit."""
        return self.stages["C"]


def identify_from_loads(
    objective: Objective,
    finer: ForwardModel,
    start: Mapping[str, float],
    law: Sequence[str],
    knots: Sequence[str],
    sizes: tuple[float, float],
    most: int,
    log: Log,
) -> LoadsFit:
    """Fit the law and the elongation, correct the simulation, and fit again with the λ's.

    Args:
        objective: data without images, and priors, those of the knots among them.
        finer: finer mesh and steps, for the correction.
        start: every parameter at the start.
        law: names of the law's parameters (and of nuisances of the loads).
        knots: names of the elongation knots.
        sizes: element sizes of the working and of the finer mesh [µm].
        most: largest number of iterations of each fit.
        log: takes one line of progress.

    Raises:
        SolverError: the model cannot be evaluated at the start.
    """
    model, data = objective.model, objective.data
    stiffness = elastic_stiffness(model, start)
    log(f"the law from the loads; elastic stiffness {1e-3 * stiffness:.1f} µN/nm")
    weights = model.boundary.weights[model.image_row]
    begin = unload_elastically(start, stiffness, weights, data.load)
    first = fit(objective, begin, (*knots, *law), most, log, share=START)
    log("finer mesh and steps at the result, for the correction")
    change = finer.predict(first.values).load - first.best.prediction.load
    log(f"  finer − working: load {np.sqrt(np.mean(change**2)):.2f} µN rms")
    left = share_left(sizes[1] / sizes[0]) * change
    error = SimulationError(np.zeros((left.size, 0)), np.zeros((0, 0)), left)
    corrected = replace(
        objective,
        data=replace(data, simulation_error=error),
        correction=Correction(0.0, change),
    )
    log("all together, with the correction")
    last = fit(corrected, first.values, (*LAMBDAS, *knots, *law), most, log)
    return LoadsFit(corrected, {"B": first, "C": last})
