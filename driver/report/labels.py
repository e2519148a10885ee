"""How causes and values of parameters are written for a reader."""

from __future__ import annotations

import math

from driver.common.formatting import number, signed, with_unit
from driver.diagnosis.causes.all_causes import cause_of
from driver.parameters.registry import declaration_of
from solver_adapters.parameter import Parameter


def cause_label(name: str) -> str:
    """Return a cause as it is written in text; one of the user's own by the words of its name."""
    cause = cause_of(name)
    return name.replace("_", " ") if cause is None else cause.title


def reading_unit(name: str, unit: str) -> tuple[float, str]:
    """Factor and unit in which a parameter is read: degrees, nanometres, GPa or percent.

    Args:
        name: the parameter.
        unit: its internal unit.
    """
    return (declaration_of(name) or Parameter(name, unit, 0.0, 1.0)).reading


def change(name: str, unit: str, amount: float, logarithmic: bool) -> str:
    """Return a departure from the null with its sign: in percent for parameters known by their log.

    Args:
        name: the parameter.
        unit: its internal unit.
        amount: departure in that unit, or of the logarithm.
        logarithmic: whether it is one of the logarithm.
    """
    if logarithmic:
        return f"{signed(100.0 * math.expm1(amount))} %"
    factor, shown = reading_unit(name, unit)
    return with_unit(signed(factor * amount), shown)


def smallest(name: str, unit: str, amount: float | None, logarithmic: bool) -> str:
    """Return the smallest magnitude that would have been seen, “not visible” if none would."""
    if amount is None:
        return "not visible"
    if logarithmic:
        relative = math.expm1(amount) if amount < 20.0 else math.inf
        if relative > 2.0:
            return "not visible below a factor of 3"
        return f"{number(100.0 * relative, 2)} %"
    factor, shown = reading_unit(name, unit)
    return with_unit(number(factor * amount, 2), shown)
