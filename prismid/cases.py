"""Cases as callers name them: read, in a file, or in a folder."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from driver.case import model
from driver.case.messages import sentences
from driver.case.model import CASE_FILE, Case, CaseError
from driver.common.errors import InputError, one_of, sentence

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
        values: what its file would state, by dotted key: {"material.tau0_MPa": 30.0}.

    Returns:
        a case that names the same file, whose folder its paths start from; `write_case` writes it
        to one of its own.

    Raises:
        CaseError: a key is unknown or a value out of range; an `InputError`.

    Examples:
        >>> import prismid
        >>> softer = prismid.changed("alpha", {"material.tau0_MPa": 30.0})
        >>> softer.material.to_material().tau0
        30.0
    """
    before = read(case)
    data = before.model_dump(mode="json")
    for key, value in values.items():
        *tables, last = key.split(".")
        table: Any = data
        for name in tables:
            if not isinstance(table.get(name), dict):
                expected = one_of(name, tuple(table))
                raise CaseError(sentence(before.file, key, f"the table {name}", expected))
            table = table[name]
        table[last] = value
    try:
        return Case.model_validate(data, context={"file": before.file})
    except ValidationError as error:
        raise CaseError(sentences(before.file, Case, data, error)) from None


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
