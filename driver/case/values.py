"""Kinds of values in the case file, and the table that holds them."""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from driver.case.messages import refusal

LARGEST = 1e12
"""Largest number of a case, whatever its unit: squares and products of it are finite."""

Number = Annotated[float, Field(strict=True, ge=-LARGEST, le=LARGEST)]
Positive = Annotated[float, Field(strict=True, gt=0, le=LARGEST)]
NonNegative = Annotated[float, Field(strict=True, ge=0, le=LARGEST)]
Frame = Annotated[int, Field(strict=True, ge=0)]
Count = Annotated[int, Field(strict=True, ge=1, le=100_000)]
Few = Annotated[int, Field(strict=True, ge=1, le=4096)]
"""As many processes or threads as a machine may have."""
FileName = Annotated[str, Field(min_length=1)]


def _as_it_stands(name: str) -> str:
    """Refuse the name of a folder that a shell would have turned into another one."""
    if name.startswith(("~", "$")):
        raise refusal("the path itself: what stands for a folder in a shell does not here")
    return name


NewFolder = Annotated[str, Field(min_length=1), AfterValidator(_as_it_stands)]
"""A folder that is made where there is none."""


def _beside_the_case(name: str) -> str:
    """Refuse what is no name of a folder beside the case: a case writes nowhere else by itself."""
    if name.startswith(".") or "/" in name or "\0" in name or len(name.encode()) > 200:
        raise refusal("the name of a folder beside the case; `--results` takes any path")
    return name


OwnFolder = Annotated[str, Field(min_length=1), AfterValidator(_beside_the_case)]
"""A folder beside the case."""
Point = tuple[Number, Number]
Vector = tuple[Number, Number, Number]


class Table(BaseModel):
    """A frozen table of the case file that refuses unknown keys."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    added: ClassVar[frozenset[str]] = frozenset()
    """Keys that came later than results which hold: at their defaults they change no result."""
