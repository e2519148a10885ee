"""Parameters by the draws of their posterior, beside what the Hessian says of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from driver.identification.objective import Evaluation
from driver.posterior.importance_sampling import TRUSTED, Weighted
from solver_adapters.parameter import Parameter

_INTERVAL = np.array([0.025, 0.5, 0.975])
_POOR = ": not the Gaussian about the identified value"
_SCATTER = 2.0  # standard errors of mean and σ
_SHIFTED, _WIDENED = 0.25, 0.15
"""Shift of the mean [σ] and change of σ beyond which the Gaussian is called a poor one."""


@dataclass(frozen=True)
class Sampled:
    """A parameter by its posterior.

    Attributes:
        name: the parameter.
        unit: of the numbers.
        value, sigma: as identified: the maximum, and the standard deviation by the Hessian.
        mean, deviation: of the posterior.
        lower, median, upper: its quantiles of 2.5, 50 and 97.5 %.
    """

    name: str
    unit: str
    value: float
    sigma: float
    mean: float
    deviation: float
    lower: float
    median: float
    upper: float

    def poor(self, effective: float) -> bool:
        """Whether the Gaussian tells another mean or another σ, by more than draws leave open.

        Args:
            effective: how many draws of the posterior the weighted ones are worth.
        """
        shift = abs(self.mean - self.value) / self.sigma
        widening = abs(np.log(self.deviation / self.sigma))
        return bool(
            shift > _SHIFTED + _SCATTER / np.sqrt(effective)
            or widening > np.log1p(_WIDENED) + _SCATTER / np.sqrt(2 * effective)
        )


def sampled(
    name: str,
    at: Evaluation,
    parameters: Mapping[str, Parameter],
    sets: Sequence[Mapping[str, float]],
    found: Weighted,
) -> Sampled:
    """Return the moments of a parameter.

    Args:
        name: the parameter.
        at: evaluation at the maximum.
        parameters: declarations by name.
        sets: every parameter of each draw.
        found: the weights of the draws.
    """
    row = at.free.index(name)
    known, value = parameters[name], at.values[name]
    sigma = float(np.sqrt(np.linalg.inv(at.hessian)[row, row]) * known.slope(value))
    drawn = np.array([values[name] for values in sets])
    lower, median, upper = found.quantiles(drawn, _INTERVAL).tolist()
    return Sampled(
        name, known.unit, value, sigma, float(found.mean(drawn)), float(found.deviation(drawn)),
        lower, median, upper,
    )  # fmt: skip


def lines_of(table: Sequence[Sampled], found: Weighted, failed: int) -> Iterator[str]:
    """Return what is told of a posterior, line by line.

    Args:
        table: its parameters.
        found: the weights of the draws.
        failed: how many draws could not be simulated.
    """
    draws = len(found.weights)
    yield (
        f"{draws} draws, worth {found.effective:.0f} of the posterior itself; Pareto k "
        f"{found.shape:.2f}" + (f"; {failed} could not be simulated" if failed else "")
    )
    if found.shape > TRUSTED:
        yield (
            f"  k is above {TRUSTED}: a few draws bear the weight, and the numbers below are not "
            "to be trusted; more draws (--draws), or tighter priors"
        )
    for one in table:
        yield (
            f"  {one.name}: {one.value:.5g} ± {one.sigma:.2g}{_unit(one.unit)} by the Hessian; "
            f"posterior {one.mean:.5g} ± {one.deviation:.2g}, 95 % from {one.lower:.5g} to "
            f"{one.upper:.5g}"
            + (_POOR if found.shape <= TRUSTED and one.poor(found.effective) else "")
        )


def _unit(unit: str) -> str:
    return f" {unit}" if unit else ""
