"""Causes of the user's own, read from small files that a case names."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from driver.case.messages import refusal
from driver.case.model import Case, CaseError
from driver.case.toml import read_tables
from driver.case.values import Table
from driver.common.errors import InputError, one_of, sentence
from driver.diagnosis.causes.all_causes import cause_of, names
from driver.diagnosis.causes.causes import Cause
from driver.diagnosis.causes.grain_causes import library
from driver.parameters.boundary import LAMBDAS
from driver.parameters.microstructure import grains_that_bear, moves_boundary
from driver.parameters.pose import POSE_DECLARATIONS
from driver.parameters.registry import declared_parameters

_ALWAYS_FITTED = {*LAMBDAS, *(parameter.name for parameter in POSE_DECLARATIONS)}


def _clause(text: str) -> str:
    """Return a text as it stands inside a sentence: in one line, without a full stop of its own."""
    clause = " ".join(text.split()).rstrip(".")
    if not clause or not clause.isprintable():
        raise refusal("a text in quotes, with at least a word and no control characters")
    return clause


Clause = Annotated[str, AfterValidator(_clause)]


class CauseTable(Table):
    """A table [[causes]], with the fields of `Cause`."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z]\w*$")] = Field(
        description="a name of letters, digits and _"
    )
    category: Literal["material", "microstructure", "boundary", "instrument"] = Field(
        description='"material", "microstructure", "boundary" or "instrument"'
    )
    parameters: tuple[str, ...] = Field(
        min_length=1, description="a list of names of parameters of the general model"
    )
    sentence: Clause = Field(description="a text in quotes, what a person would say of it")
    check: Clause = Field(description="a text in quotes, the physical check that would confirm it")
    companions: tuple[str, ...] = Field(
        default=(), description="a list of names of parameters that exist only with this cause"
    )
    one_sided: bool = Field(default=False, strict=True, description="true or false")

    @model_validator(mode="after")
    def _parameters_of_the_model(self) -> Self:
        known = [
            name
            for name in declared_parameters(1, n_grains=self._grains())
            if name not in _ALWAYS_FITTED
        ]
        seen: set[str] = set()
        for key in ("parameters", "companions"):
            for name in getattr(self, key):
                if name not in known:
                    raise refusal(one_of(name, known), key, f'the name "{name}"')
                if name in seen:
                    raise refusal("each name once", key, f'"{name}" twice')
                seen.add(name)
        if self.one_sided and len(self.parameters) > 1:
            found = f"true with {len(self.parameters)} parameters"
            raise refusal("true for a cause of one parameter alone", "one_sided", found)
        return self

    @model_validator(mode="after")
    def _of_its_own(self) -> Self:
        if self.name.lower() == "all" or cause_of(self.name.lower()) is not None:
            raise refusal('a name that the library does not have, nor "all"', "name")
        for cause in library(self._grains()):
            if set(cause.parameters) == set(self.parameters):
                raise refusal(
                    f"other parameters than those of {cause.name} of the library", "parameters"
                )
        return self

    def _grains(self) -> int:
        """Fewest grains of a specimen that has all of the parameters."""
        return max(map(grains_that_bear, (*self.parameters, *self.companions)))

    def cause(self) -> Cause:
        """Return the cause that the table describes."""
        return Cause(**self.model_dump())


class CauseFile(Table):
    """A file of causes."""

    causes: tuple[CauseTable, ...] = Field(description="one or more tables [[causes]]")

    @model_validator(mode="after")
    def _not_empty(self) -> Self:
        if not self.causes:
            raise refusal("one or more tables [[causes]]", "causes")
        return self


def read_causes(path: Path) -> tuple[Cause, ...]:
    """Return the causes of a file.

    Raises:
        InputError: the file cannot be read, or describes no causes: a sentence a line, with file,
            key, found, expected.
    """
    tables = read_tables(path, CauseFile, "the tables [[causes]] of diagnosis.cause_files")
    return tuple(table.cause() for table in tables.causes)


def user_causes(case: Case) -> tuple[Cause, ...]:
    """Return the causes of all files that a case names.

    Raises:
        InputError: as `read_causes`; or two causes have one name, or the same parameters.
    """
    causes: dict[str, Cause] = {}
    for path, cause in _of_files([case.path(name) for name in case.diagnosis.cause_files]):
        if cause.name in causes:
            raise InputError(
                sentence(path, "causes.name", f'"{cause.name}" again', "a name for each cause")
            )
        for other in causes.values():
            if set(other.parameters) == set(cause.parameters):
                expected = f"other parameters than those of {other.name}"
                found = f"{cause.name} of {', '.join(cause.parameters)}"
                raise InputError(sentence(path, "causes.parameters", found, expected))
        causes[cause.name] = cause
    return tuple(causes.values())


def asked_causes(case: Case, path: Path | None = None) -> tuple[Cause, ...]:
    """Return the causes of all files that a case names, once every cause that it asks for is found.

    Args:
        case: the case.
        path: where it stands, to be told; None for its own file.

    Raises:
        InputError: as `user_causes`; or names are of no cause of the library or of the files, a
            sentence a line.
    """
    own = user_causes(case)
    known = [*names(len(case.grains)), *(cause.name for cause in own)]
    if case.specimen.boundaries_stay:
        known = [name for name in known if not moves_boundary(name)]
    asked = case.diagnosis.causes if case.diagnosis.causes != "all" else ()
    refused = [
        sentence(path or case.file, "diagnosis.causes", f'"{name}"', _expected(case, name, known))
        for name in asked
        if name not in known
    ]
    if refused:
        raise CaseError("\n".join(refused))
    return own


def _expected(case: Case, name: str, known: Sequence[str]) -> str:
    if case.specimen.boundaries_stay and moves_boundary(name):
        return "no cause of a grain boundary: those of specimen.mesh_file and labels stay"
    return one_of(name, known)


def _of_files(paths: Sequence[Path]) -> Iterator[tuple[Path, Cause]]:
    for path in paths:
        for cause in read_causes(path):
            yield path, cause
