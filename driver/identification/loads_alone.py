"""The law from the loads alone, where the elongation is known from the stage travel.

The knots are free with the stage travel as their prior: the loads fix what they are sharper in,
which is every elastic unloading. The correction of the simulation is that of the loads.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from driver.forward.model import ForwardModel
from driver.identification.correction import correction
from driver.identification.discretisation_covariance import DiscretisationError
from driver.identification.fit import fit, to_its_end
from driver.identification.identifiability import refuse_what_is_not_seen
from driver.identification.identify import (
    FAR,
    MOST_CORRECTIONS,
    START,
    Identification,
    Plan,
    elastic_stiffness,
    unload_elastically,
)
from driver.identification.mesh_error import load_left
from driver.identification.objective import Objective

logger = logging.getLogger(__name__)

_BEYOND = 4.0  # standard deviations of χ_F from which a misfit is told


def identify_from_loads(
    objective: Objective,
    finer: ForwardModel,
    start: Mapping[str, float],
    plan: Plan,
) -> Identification:
    """Fit the law and the elongation, correct the simulation, and fit again with the λ's.

    Args:
        objective: data without images, and priors, those of the knots among them.
        finer: finer mesh and steps, for the correction.
        start: every parameter at the start.
        plan: which parameters are free, and how it is run.

    Returns:
        Stages B, without the correction, and C, with it and with free λ's.

    Raises:
        SolverError: the model cannot be evaluated at the start.
        InputError: loads and priors leave a combination of parameters open.
    """
    model, data = objective.model, objective.data
    stiffness = elastic_stiffness(model, start)
    logger.info(f"the law from the loads; elastic stiffness {1e-3 * stiffness:.1f} µN/nm")
    weights = model.boundary.weights[model.image_row][data.load_index]
    begin = unload_elastically(start, stiffness, weights, data.load[data.load_index])
    first = fit(objective, begin, plan.free("B"), plan.most, share=START)
    last = first
    for turn in range(MOST_CORRECTIONS):
        logger.info("finer mesh and steps at the result, for the correction")
        here = last
        change = correction(model, finer, here.best.prediction, here.values)
        left = load_left(model.microstructure.mesh, plan.sizes, change.of_mesh[1], data.load)
        error = DiscretisationError(np.zeros((left.size, 0)), np.zeros((0, 0)), left)
        corrected = replace(
            objective,
            data=replace(data, simulation_error=error, step_error=change.left_by_steps),
            correction=replace(change, motion=0.0),
        )
        again = " of its result" if turn else ""
        logger.info(f"all together, with the correction{again}")
        last = fit(corrected, here.values, plan.free("C"), plan.most)
        if (away := last.away_from(here.best, objective.parameters)) < FAR:
            break
        logger.info(f"  it ended {away:.2g} σ from where its correction was taken")
    last = to_its_end(last, corrected, plan.most)
    refuse_what_is_not_seen(last.best)
    return Identification(corrected, {"B": first, "C": last}, plan.law)


def doubts(chi_load: float, n_loads: int, converged: bool) -> tuple[str, ...]:
    """Sentences on what makes the uncertainties of a fit to loads alone too small, if anything.

    No diagnosis follows: nobody else tells it.

    Args:
        chi_load: root mean square of the whitened load residual.
        n_loads: number of loads.
        converged: whether the fit has.
    """
    sentences = []
    if not converged:
        sentences.append("the fit has not converged: take the values as a start, not as a result")
    scatter = 1 / np.sqrt(2 * n_loads)
    if chi_load > 1 + _BEYOND * scatter:
        sentences.append(
            f"χ_F {chi_load:.2f} is more than noise makes (1 ± {scatter:.2f}): the model does not "
            "carry these loads, and the uncertainties do not count that"
        )
    return tuple(sentences)
