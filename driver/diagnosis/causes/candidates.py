"""Which causes are tried on a specimen, and why the others are not."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

from driver.diagnosis.causes.causes import Cause
from driver.diagnosis.causes.grain_causes import library
from driver.parameters.registry import label_of


@dataclass(frozen=True)
class NotExamined:
    """A cause that was asked for and not tried.

    Attributes:
        cause: its name.
        why: the reason, as the end of a sentence.
    """

    cause: str
    why: str


_ABSENT = {
    "fixed_pattern": "no flats show the pattern",
    "hold_time_error": "the stage holds nowhere",
}


def not_examined(
    specimen: Collection[str],
    solver: Collection[str],
    fitted: Collection[str],
    wanted: Sequence[str] | None,
    own: Sequence[Cause] = (),
    n_grains: int = 2,
) -> tuple[NotExamined, ...]:
    """Return the causes that are not tried, each with its reason.

    Args:
        specimen: parameters of the general model that this specimen has.
        solver: those that its solver can honour.
        fitted: parameters that are fitted in the baseline.
        wanted: names of the causes to try, None for all.
        own: causes beside the library.
        n_grains: grains of the specimen.
    """
    asked = _asked(wanted, own, n_grains)
    reasons = [(cause, _why_not(cause, specimen, solver, fitted)) for cause in asked]
    return tuple(NotExamined(cause.name, why) for cause, why in reasons if why)


def causes_of(
    known: Collection[str],
    fitted: Collection[str],
    wanted: Sequence[str] | None,
    own: Sequence[Cause] = (),
    n_grains: int = 2,
) -> tuple[Cause, ...]:
    """Return the causes that this specimen can have and that are not fitted already.

    Args:
        known: parameters of the general model that this specimen has.
        fitted: parameters that are fitted in the baseline.
        wanted: names of the causes to try, None for all.
        own: causes beside the library.
        n_grains: grains of the specimen.
    """
    return tuple(
        cause
        for cause in _asked(wanted, own, n_grains)
        if not _why_not(cause, known, known, fitted)
    )


def _asked(wanted: Sequence[str] | None, own: Sequence[Cause], n_grains: int) -> list[Cause]:
    """Those of the library that are wanted, and all own ones: their file asks for them."""
    of_library = library(n_grains)
    return [cause for cause in of_library if wanted is None or cause.name in wanted] + list(own)


def _why_not(
    cause: Cause, specimen: Collection[str], solver: Collection[str], fitted: Collection[str]
) -> str:
    """Why a cause cannot be tried, empty where it can."""
    for name in (*cause.parameters, *cause.companions):
        if name not in specimen:
            return _ABSENT.get(name, f"the specimen has no {label_of(name)}")
    for name in (*cause.parameters, *cause.companions):
        if name not in solver:
            return f"the solver cannot honour {label_of(name)}"
    for name in cause.parameters:
        if name in fitted:
            return f"{label_of(name)} is fitted in the baseline"
    return ""
