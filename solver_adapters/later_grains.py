"""Ratio of τ0 in the third and later grains: scalars of the law that bear the number of a grain."""

from __future__ import annotations

import re
from dataclasses import replace

from solver_adapters.parameter import POSITIVE, Parameter

SECOND = "tau0_grain2"
"""Ratio of the second grain, which each law has; solvers honour those of later ones like it."""
_NUMBERED = re.compile(r"tau0_grain([1-9]\d{0,2})")


def ratio_name(grain: int) -> str:
    """Name of the ratio of τ0 in a grain to that in the first."""
    return f"tau0_grain{grain}"


def later_grain(name: str) -> int | None:
    """Return the number of the third or later grain whose ratio has a name; None of another."""
    found = _NUMBERED.fullmatch(name)
    return int(found[1]) if found is not None and int(found[1]) > 2 else None


def as_honoured(name: str) -> str:
    """Return the name by which solvers say whether they honour a scalar."""
    return name if later_grain(name) is None else SECOND


def ratio_of(second: Parameter, grain: int) -> Parameter:
    """Return the declaration of the ratio of a later grain, which no key of its own states.

    Args:
        second: that of the second grain.
        grain: number of the later one.
    """
    return replace(
        second, name=ratio_name(grain), key="", label=f"τ₀ of grain {grain} / τ₀ of grain 1",
        admissible=POSITIVE,
    )  # fmt: skip
