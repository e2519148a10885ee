"""Which causes are tried on a specimen, and why the others are not."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

from driver.diagnosis.causes import LIBRARY, Cause


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
) -> tuple[NotExamined, ...]:
    """The causes that are not tried, each with its reason.

    Args:
        specimen: parameters of the general model that this specimen has.
        solver: those that its solver can honour.
        fitted: parameters that are fitted in the baseline.
        wanted: names of the causes to try, None for all.
        own: causes beside the library.
    """
    left: list[NotExamined] = []
    for cause in (*LIBRARY, *own):
        if wanted is not None and cause.name not in wanted:
            continue
        absent = [name for name in cause.parameters if name not in specimen]
        refused = [name for name in cause.parameters if name not in solver]
        free = [name for name in cause.parameters if name in fitted]
        if absent:
            why = _ABSENT.get(absent[0], f"the specimen has no {absent[0]}")
            left.append(NotExamined(cause.name, why))
        elif refused:
            left.append(NotExamined(cause.name, f"the solver cannot honour {refused[0]}"))
        elif free:
            left.append(NotExamined(cause.name, f"{free[0]} is fitted in the baseline"))
    return tuple(left)


def causes_of(
    known: Collection[str],
    fitted: Collection[str],
    wanted: Sequence[str] | None,
    own: Sequence[Cause] = (),
) -> tuple[Cause, ...]:
    """The causes that this specimen can have and that are not fitted already.

    Args:
        known: parameters of the general model that this specimen has.
        fitted: parameters that are fitted in the baseline.
        wanted: names of the causes to try, None for all.
        own: causes beside the library.
    """
    return tuple(
        cause
        for cause in (*LIBRARY, *own)
        if set(cause.parameters) <= set(known)
        and not set(cause.parameters) & set(fitted)
        and (wanted is None or cause.name in wanted)
    )
