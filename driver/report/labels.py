"""How parameters and causes are written for a reader: by the labels of their declarations."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from functools import cache

from driver.common.formatting import number, signed, with_unit
from driver.diagnosis.causes.all_causes import EVERY
from driver.diagnosis.causes.causes import DISCRETISATION
from driver.diagnosis.causes.noise_causes import COVARIANCE_PARAMETERS
from driver.parameters.registry import declared_parameters
from solver_adapters.parameter import Parameter

_OF_NO_MODEL = {**COVARIANCE_PARAMETERS, DISCRETISATION.name: DISCRETISATION}


def _declared(name: str) -> Parameter | None:
    """Return the declaration of a parameter; None of one that is declared no more."""
    knot = re.fullmatch(r"(?:elongation|tilt)_(\d+)", name)
    model = declared_parameters(int(knot[1]) + 1 if knot else 1)
    return model.get(name) or _OF_NO_MODEL.get(name)


@cache
def _titles() -> dict[str, str]:
    return {cause.name: cause.title for cause in EVERY}


def label(name: str) -> str:
    """Return parameter as it is written in tables and figures; K, n, c, d stand for themselves."""
    declared = _declared(name)
    return (declared.label if declared else "") or name


def short_label(name: str) -> str:
    """Return a parameter where there is little room, as beside a matrix."""
    declared = _declared(name)
    return (declared.short if declared else "") or label(name)


def cause_label(name: str) -> str:
    """Return a cause as it is written in text; one of the user's own by the words of its name."""
    return _titles().get(name, name.replace("_", " "))


def readable(text: str, causes: Iterable[str]) -> str:
    """Return a text with the names of these causes as they are written."""
    for name in sorted(causes, key=len, reverse=True):
        text = re.sub(rf"\b{name}\b", cause_label(name), text)
    return text


def named(text: str, parameters: Iterable[str]) -> str:
    """Return a text with these parameters as they are written."""
    for name in sorted(parameters, key=len, reverse=True):
        if len(name) > 1:
            text = re.sub(rf"\b{name}\b", label(name), text)
    return text


def reading_unit(name: str, unit: str) -> tuple[float, str]:
    """Factor and unit in which a parameter is read: degrees, nanometres, GPa or percent.

    Args:
        name: the parameter.
        unit: its internal unit.
    """
    return (_declared(name) or Parameter(name, unit, 0.0, 1.0)).reading


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
