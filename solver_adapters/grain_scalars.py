"""Scalars of the law that bear the number of a grain: names, and declarations of later grains.

They are the ratio of τ0, the modes of ln τ0 inside the grain, and a band across it.
"""

from __future__ import annotations

import re
from dataclasses import replace

from solver_adapters.parameter import Parameter

MODE_SHAPES = ("slope_Y", "bend_Y", "slope_X")
"""Ends of the names of the modes of ln τ0 inside a grain."""
INSIDE_NULL = (0.0, 0.0, 0.0, 0.0, 0.0, 0.25)
"""Modes and band of a grain in which τ0 is the same everywhere, in the order of `inside_names`."""
_BAND_PARTS = ("band", "band_middle", "band_half_width")
_RATIO = re.compile(r"tau0_grain([1-9]\d{0,2})")
_NUMBERED = re.compile(rf"{_RATIO.pattern}(_(?:{'|'.join((*MODE_SHAPES, *_BAND_PARTS))}))?")


def ratio_name(grain: int) -> str:
    """Name of the ratio of τ0 in a grain to that in the first."""
    return f"tau0_grain{grain}"


def mode_names(grain: int) -> tuple[str, ...]:
    """Names of the modes of ln τ0 inside a grain, in the order of `MODE_SHAPES`."""
    return tuple(f"tau0_grain{grain}_{shape}" for shape in MODE_SHAPES)


def band_names(grain: int) -> tuple[str, str, str]:
    """Names of the band across a grain: its height, its middle, half of its width."""
    height, middle, half_width = (f"tau0_grain{grain}_{part}" for part in _BAND_PARTS)
    return height, middle, half_width


def inside_names(grain: int) -> tuple[str, ...]:
    """Names of the modes inside a grain and of the band across it."""
    return (*mode_names(grain), *band_names(grain))


def later_names(n_grains: int) -> tuple[str, ...]:
    """Names of all scalars of the third and later grains of a specimen of so many."""
    later = range(3, n_grains + 1)
    return tuple(name for grain in later for name in (ratio_name(grain), *inside_names(grain)))


def later_grain(name: str) -> int | None:
    """Return the number of the third or later grain whose scalar has a name; None of another."""
    return _third_or_later(_NUMBERED.fullmatch(name))


def grain_of_later_ratio(name: str) -> int | None:
    """Return the number of the third or later grain whose ratio has a name; None of another."""
    return _third_or_later(_RATIO.fullmatch(name))


def _third_or_later(found: re.Match[str] | None) -> int | None:
    return int(found[1]) if found is not None and int(found[1]) > 2 else None


def as_honoured(name: str) -> str:
    """Return the name by which solvers say whether they honour a scalar: that of grain 2."""
    grain = later_grain(name)
    return name if grain is None else name.replace(ratio_name(grain), ratio_name(2))


def of_later_grain(second: Parameter, grain: int) -> Parameter:
    """Return the declaration of a scalar of a later grain, which no key of its own states.

    Args:
        second: that of the second grain.
        grain: number of the later one.
    """
    name = second.name.replace(ratio_name(2), ratio_name(grain))
    return replace(
        second, name=name, key="", label=second.label.replace("grain 2", f"grain {grain}")
    )
