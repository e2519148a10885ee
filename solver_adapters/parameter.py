"""How a parameter of the general model is declared: null, unit, scale, bounds, label, key."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, inf, isfinite, log, pi
from typing import Literal

Place = Literal[
    "law", "knots", "ends", "clock", "nodes", "orientations", "lattice", "load", "images",
    "pixels", "pattern", "covariance",
]  # fmt: skip
"""Where a parameter enters: the crystal law, the knots of the boundary motion, the rest of that
motion, the instants of the history, node coordinates, grain orientations, gradients of the lattice,
what the load cell reads, what images show, where pixels lie, the pattern left in images, or the
covariance of the data."""

Reading = tuple[float, str]
"""Factor and unit in which a value is read."""
NANOMETRES: Reading = (1e3, "nm")
GIGAPASCALS: Reading = (1e-3, "GPa")
PERCENT: Reading = (100.0, "%")
MILLIRADIANS: Reading = (1e3, "mrad")
_DEGREES = 180.0 / pi
_OF_ANGLES = {"rad": (_DEGREES, "°"), "rad/µm": (_DEGREES, "°/µm")}


@dataclass(frozen=True)
class Range:
    """Finite numbers between two bounds.

    Attributes:
        words: the same as it is told: what was expected.
        lower, upper: the bounds.
        open: whether the bounds themselves are left out.
    """

    words: str
    lower: float = -inf
    upper: float = inf
    open: bool = False

    def holds(self, value: float) -> bool:
        """Whether a number is one of these."""
        if self.open and value in (self.lower, self.upper):
            return False
        return isfinite(value) and self.lower <= value <= self.upper


FINITE = Range("a finite number")
POSITIVE = Range("a positive number", 0, open=True)
NOT_NEGATIVE = Range("zero or more", 0)


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
        lower, upper: bounds of the value in a fit.
        logarithmic: whether the parameter is positive and identified by its logarithm.
        enters: where it enters the model.
        label: as it is written in tables and figures; empty where the name is.
        short: the same where there is little room; empty where the label is short.
        key: dotted key of its start in the case; empty where only [extensions] states it.
        deviation_key: dotted key of its standard deviation before data, where the case states one.
        read_in: factor and unit in which it is read, where that is not the internal unit.
        admissible: what it may be at all; a fit may well stay inside of that.
        startable: what of it a case may state; None where that is all of it.
        ends_at_bounds: whether nothing of the kind occurs beyond the bounds.
    """

    name: str
    unit: str
    null: float
    scale: float
    lower: float = -inf
    upper: float = inf
    logarithmic: bool = False
    enters: Place = "law"
    label: str = ""
    short: str = ""
    key: str = ""
    deviation_key: str = ""
    read_in: Reading | None = None
    admissible: Range = FINITE
    startable: Range | None = None
    ends_at_bounds: bool = False

    @property
    def title(self) -> str:
        """The parameter as it is written in tables, figures and text; K, n, c, d by their names."""
        return self.label or self.name

    @property
    def short_title(self) -> str:
        """The same where there is little room, as beside a matrix."""
        return self.short or self.title

    @property
    def reading(self) -> Reading:
        """Factor and unit in which the value is read: degrees, nanometres, GPa or percent."""
        return self.read_in or _OF_ANGLES.get(self.unit, (1.0, self.unit))

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
        """Return a typical change of the value: one prior scale."""
        return self.scale * value if self.logarithmic else self.scale
