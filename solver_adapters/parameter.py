"""How a parameter of the general model is declared: null, unit, scale, bounds."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, inf, log


@dataclass(frozen=True)
class Parameter:
    """One scalar of the general model and the variable θ in which it is identified.

    θ = log(p / reference) if ``logarithmic``, else θ = (p − reference) / scale; the reference is
    the value at the start of a fit.

    Attributes:
        name: unique name.
        unit: unit of the value, "" for a ratio.
        null: value at which the parameter changes nothing (or its usual start).
        scale: prior scale; of log p for logarithmic parameters, else in the parameter's unit.
        lower, upper: bounds of the value.
        logarithmic: whether the parameter is positive and identified by its logarithm.
    """

    name: str
    unit: str
    null: float
    scale: float
    lower: float = -inf
    upper: float = inf
    logarithmic: bool = False

    @property
    def width(self) -> float:
        """One prior scale in θ."""
        return self.scale if self.logarithmic else 1.0

    def theta(self, value: float, reference: float) -> float:
        """θ of a value."""
        return log(value / reference) if self.logarithmic else (value - reference) / self.scale

    def value(self, theta: float, reference: float) -> float:
        """Value of θ, kept inside the bounds."""
        raw = reference * exp(theta) if self.logarithmic else reference + theta * self.scale
        return min(max(raw, self.lower), self.upper)

    def slope(self, value: float) -> float:
        """∂value/∂θ."""
        return value if self.logarithmic else self.scale

    def change(self, value: float) -> float:
        """A typical change of the value: one prior scale."""
        return self.scale * value if self.logarithmic else self.scale
