"""The library of causes of a specimen with more than two grains: those of grains by their number.

What is said of grain 2 is said of each later one, and what is said of the grain boundary of each of
several. Names of two grains stay what they are.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from driver.diagnosis.causes.causes import LIBRARY, Cause
from driver.parameters.microstructure import boundary_names

_BY_NUMBER = (
    "heterogeneity_grain2",
    "band_grain2",
    "misorientation_grain2",
    "lattice_gradient_grain2",
)


def library(n_grains: int) -> tuple[Cause, ...]:
    """Return the library of a specimen, in the order of that of two grains.

    Args:
        n_grains: grains of the specimen.
    """
    if n_grains <= 2:
        return LIBRARY
    found: list[Cause] = []
    for cause in LIBRARY:
        if cause.name == "grain_contrast":
            found += [_contrast(cause, grain) for grain in range(2, n_grains + 1)]
        elif cause.name in _BY_NUMBER:
            found += [_renamed(cause, _of_grain(grain)) for grain in range(2, n_grains + 1)]
        elif cause.name.startswith("boundary_"):
            found += [_of_boundary(cause, number) for number in range(1, n_grains)]
        else:
            found.append(cause)
    return tuple(found)


def _of_grain(grain: int) -> Callable[[str], str]:
    """Return what makes a name or a text of grain 2 one of another grain."""

    def told(text: str) -> str:
        return text.replace("grain2", f"grain{grain}").replace("grain 2", f"grain {grain}")

    return told


def _renamed(cause: Cause, renamed: Callable[[str], str]) -> Cause:
    return replace(
        cause,
        name=renamed(cause.name),
        parameters=tuple(map(renamed, cause.parameters)),
        companions=tuple(map(renamed, cause.companions)),
        sentence=renamed(cause.sentence),
        check=renamed(cause.check),
        label=renamed(cause.label),
    )


def _contrast(cause: Cause, grain: int) -> Cause:
    return replace(
        cause,
        name=f"grain{grain}_contrast",
        parameters=tuple(map(_of_grain(grain), cause.parameters)),
        sentence=f"grain {grain} has another critical resolved shear stress than grain 1",
        check=f"nano-indentation of grain 1 and grain {grain}, or their chemistry (interstitials) "
        "by atom probe",
        label=f"contrast of grain {grain}",
    )


def _of_boundary(cause: Cause, number: int) -> Cause:
    two, here = boundary_names(2)[0], boundary_names(number + 2)[number - 1]
    place = dict(zip(two, here, strict=True))

    def told(text: str) -> str:
        numbered = text.replace("the grain boundary", f"grain boundary {number}")
        return numbered.replace("the boundary", f"boundary {number}")

    return replace(
        cause,
        name=cause.name.replace("boundary", f"boundary{number}"),
        parameters=tuple(place[name] for name in cause.parameters),
        sentence=told(cause.sentence),
        check=told(cause.check),
        label=told(cause.label),
    )
