"""Elongation over stage travel by the identified model.

Free correlation carries the mean stretch of the region of interest on to the ends. The model knows
the shape of the motion, and its knots are the motion of the ends themselves.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from driver.common.formatting import number, with_sigma
from driver.experiment.history import History, knot_weights
from driver.identification.fit import Fit
from driver.parameters.boundary import elongation_names
from solver_adapters.parameter import Parameter


@dataclass(frozen=True)
class TravelRatio:
    """What a test without images of a specimen of this kind may state.

    Attributes:
        value: slope of the line through elongation over stage travel of all images [1].
        sigma: its standard deviation by that of the knots [1].
        of_phases: root mean square of the departure of the ratios of single phases from it [1].
    """

    value: float
    sigma: float
    of_phases: float

    def sentence(self) -> str:
        """Return what a person should know of it."""
        told = with_sigma(1e4 * self.value, 1e4 * self.sigma)
        return (
            f"by the motion of the ends in the model the elongation is ({told})·10⁻⁴ of the stage "
            f"travel, and in a single phase {number(1e4 * self.of_phases, 2)}·10⁻⁴ off that: "
            "stage_ratio and stage_ratio_uncertainty of a like specimen without images"
        )


def travel_ratio(
    fit: Fit, parameters: Mapping[str, Parameter], history: History
) -> TravelRatio | None:
    """Read the ratio off the knots of a fit.

    Args:
        fit: the fit.
        parameters: declarations by name.
        history: of the test.

    Returns:
        None where the fit held a knot.
    """
    names = elongation_names(history.n_knots)
    if not set(names) <= set(fit.best.free):
        return None
    rows = [fit.best.free.index(name) for name in names]
    knots = np.array([fit.values[name] for name in names])
    units = np.array([parameters[name].slope(fit.values[name]) for name in names])
    covariance = fit.covariance[np.ix_(rows, rows)] * np.outer(units, units)
    # The slope of a line by least squares is linear in the knots.
    stage = history.stage[history.image_row]
    centred = stage - stage.mean()
    weights = centred @ knot_weights(history)[history.image_row, 1:] / (centred @ centred)
    value = float(weights @ knots)
    phases = np.diff([0.0, *knots]) / np.diff(history.stage[history.turning])
    return TravelRatio(
        value,
        float(np.sqrt(weights @ covariance @ weights)),
        float(np.sqrt(np.mean((phases - value) ** 2))),
    )
