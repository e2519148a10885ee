"""What the identification says of each parameter: interval, prior and its share, bound."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from meshes.arrays import FloatArray
from solver_adapters.parameter import Parameter

COVERED = 1.959964  # standard deviations to either side of 95 % of a normal distribution
_AT_BOUND = 1e-9


@dataclass(frozen=True)
class IdentifiedParameter:
    """An identified parameter.

    Attributes:
        parameter: its declaration.
        start: its value where the identification began.
        value: its value at the optimum.
        deviation: its standard deviation, in θ.
        prior_mean: value in the middle of its prior, NaN where it has none.
        prior_width: standard deviation of its prior in θ, ∞ where it has none.
        prior_share: share of its variance that comes from the prior, from 0 (data alone) to 1.
    """

    parameter: Parameter
    start: float
    value: float
    deviation: float
    prior_mean: float
    prior_width: float
    prior_share: float

    @property
    def sigma(self) -> float:
        """Its standard deviation in its own unit, to first order."""
        return self.deviation * self.parameter.slope(self.value)

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval: symmetric in θ, so that a positive parameter stays positive."""
        return interval_of(self.parameter, self.value, self.deviation)

    @property
    def prior_interval(self) -> tuple[float, float] | None:
        """95 % of the prior, None where there is none."""
        if not math.isfinite(self.prior_width):
            return None
        return interval_of(self.parameter, self.prior_mean, self.prior_width)

    @property
    def at_bound(self) -> float | None:
        """The bound at which the parameter ended, None where it ended between its bounds."""
        for bound in (self.parameter.lower, self.parameter.upper):
            if math.isfinite(bound) and abs(self.value - bound) <= _AT_BOUND * max(abs(bound), 1.0):
                return bound
        return None


def interval_of(parameter: Parameter, middle: float, deviation: float) -> tuple[float, float]:
    """Return the 95 % interval about a value, with a standard deviation in θ."""
    if parameter.logarithmic:
        factor = math.exp(COVERED * deviation)
        return middle / factor, middle * factor
    reach = COVERED * deviation * parameter.scale
    return middle - reach, middle + reach


def estimates(
    names: Sequence[str], declared: Mapping[str, Parameter], results: Mapping[str, FloatArray]
) -> dict[str, IdentifiedParameter]:
    """Estimates by name.

    Args:
        names: the identified parameters, length k.
        declared: the parameters of the general model.
        results: datasets of `identify.h5`: "start", "values", "prior/mean", "prior/width",
            "prior_share", each of shape (k,), and "covariance" of θ, shape (k, k).
    """
    deviation = np.sqrt(np.diag(results["covariance"]))
    columns = (
        results["start"], results["values"], deviation, results["prior/mean"],
        results["prior/width"], results["prior_share"],
    )  # fmt: skip
    return {
        name: IdentifiedParameter(declared[name], *map(float, row))
        for name, *row in zip(names, *columns, strict=True)
    }
