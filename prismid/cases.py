"""Cases as callers name them: read, in a file, or in a folder."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from driver.case import model
from driver.case.changes import without_what_gives_way
from driver.case.messages import sentences
from driver.case.model import CASE_FILE, Case, CaseError
from driver.common.errors import InputError, one_of, sentence
from driver.results import files

CaseLike = Case | Path | str
"""A case that was read, its file, or the folder of its `case.toml`."""


def load_case(path: Path | str) -> Case:
    """Read and validate a case file.

    Args:
        path: the file, or the folder of a `case.toml`.

    Raises:
        CaseError: the file is absent or no TOML, or a key is unknown, absent or out of range; an
            `InputError`, one sentence a line.

    Examples:
        >>> import prismid
        >>> case = prismid.load_case("alpha")
        >>> case.specimen.length_um, [grain.name for grain in case.grains]
        (12.0, ['grain 1', 'grain 2'])
    """
    return model.load_case(file_named(path))


def changed(case: CaseLike, values: Mapping[str, Any]) -> Case:
    """Return a case with other values, validated as those of a file are.

    Args:
        case: the case, its file or its folder.
        values: what its file would state, by dotted key: {"material.tau0_MPa": 30.0}; an entry of
            a list by its number from 1, as "grains.2.euler_deg".

    Returns:
        a case that names the same file, whose folder its paths start from; `write_case` writes it
        to one of its own.

    Raises:
        CaseError: a key is unknown, or lies inside another one, or a value is out of range; an
            `InputError`.

    Examples:
        >>> import prismid
        >>> softer = prismid.changed("alpha", {"material.tau0_MPa": 30.0})
        >>> softer.material.to_material().tau0
        30.0
    """
    before = read(case)
    data, of_grains = before.model_dump(mode="json"), dict[str, dict[str, Any]]()
    for key, value in values.items():
        inside = [other for other in values if other.startswith(f"{key}.")]
        if inside:
            raise CaseError(sentence(before.file, inside[0], f"{key} beside it", "one of both"))
        *tables, last = key.split(".")
        table: Any = data
        for name in tables:
            table = _inside(before, key, table, name)
        if isinstance(table, list):
            table[_place(before, key, table, last)] = value
            continue
        if not isinstance(table, dict):
            raise CaseError(sentence(before.file, key, f"no table {tables[-1]}", "the key of one"))
        table[last] = value
        if tables[:1] == ["grains"]:
            of_grains.setdefault(tables[1], {})[last] = value
    if of_grains:
        without_what_gives_way(data["grains"], of_grains)
    try:
        return Case.model_validate(data, context={"file": before.file})
    except ValidationError as error:
        raise CaseError(sentences(before.file, Case, data, error)) from None


def _inside(case: Case, key: str, above: Any, name: str) -> Any:
    """Return a table inside another, or an entry of a list.

    Args:
        case: the case.
        key: the whole key, to be told.
        above: the table or the list.
        name: of the table, or number of the entry from 1.

    Raises:
        CaseError: there is none of that name.
    """
    if isinstance(above, list):
        return above[_place(case, key, above, name)]
    if not isinstance(above, dict) or name not in above:
        expected = one_of(name, tuple(above)) if isinstance(above, dict) else "the key of a table"
        raise CaseError(sentence(case.file, key, f"the table {name}", expected))
    return above[name]


def _place(case: Case, key: str, entries: list[Any], name: str) -> int:
    """Return the place of an entry of a list that is named by its number from 1.

    Raises:
        CaseError: there is none of that number.
    """
    places = {str(number + 1): number for number in range(len(entries))}
    if name not in places:
        found, expected = f"the entry {name} of a list", "one of its numbers, counted from 1"
        raise CaseError(sentence(case.file, key, found, expected))
    return places[name]


def results_of(case: CaseLike) -> Path:
    """Return the folder of the results of a case.

    Args:
        case: the case, its file or its folder.

    Raises:
        CaseError: its file cannot be used.
    """
    return files.results_of(read(case))


def read(case: CaseLike) -> Case:
    """Return a case, read if need be."""
    return case if isinstance(case, Case) else load_case(case)


def file_of(case: CaseLike) -> Path:
    """Return the file of a case, in which it stands as it is.

    Raises:
        InputError: values of the case were changed since it was read.
        CaseError: its file cannot be used.
    """
    if not isinstance(case, Case):
        return file_named(case)
    if model.load_case(case.file) != case:
        raise InputError(
            sentence(
                case.file, "case", "other values than those of the case at hand",
                "the same: stages read the file, so write the case with "
                "prismid.write_case(case, path), and run that",
            )
        )  # fmt: skip
    return case.file


def file_named(path: Path | str) -> Path:
    """Return the case file, where it or its folder was given."""
    path = Path(path)
    return path / CASE_FILE if path.is_dir() else path
