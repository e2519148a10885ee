"""Turns the refusals of the case model into sentences about the keys of the case file."""

from __future__ import annotations

import types
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails, PydanticCustomError

from driver.common.errors import InputError, sentence, show

_BOUNDS = {
    "greater_than": ("a number > {gt:g}", "gt"),
    "greater_than_equal": ("a number ≥ {ge:g}", "ge"),
    "less_than": ("a number < {lt:g}", "lt"),
    "less_than_equal": ("a number ≤ {le:g}", "le"),
}
_KINDS = {
    "float_type": "a number",
    "finite_number": "a finite number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "string_type": "a text in quotes",
}


def refusal(expected: str, key: str = "", found: str | None = None) -> PydanticCustomError:
    """Return the error that a validator of the case raises.

    Args:
        expected: what would have been accepted.
        key: dotted key below the validated one, where the validator looks at a whole table; entries
            of a list are counted from 1.
        found: what was found, where it is more than the value of the key.
    """
    return PydanticCustomError(
        "refused", "refused", {"expected": expected, "key": key, "found": found}
    )


def sentences(
    path: Path, model: type[BaseModel], data: Mapping[str, Any], error: ValidationError
) -> str:
    """One line for each key that was refused.

    Args:
        path: the case file, as it shall be named.
        model: the model that refused.
        data: the content of the file.
        error: what the model said.
    """
    by_value: dict[tuple[str, str], list[str]] = {}
    meaning: dict[str, str] = {}
    whole: list[str] = []
    for details in error.errors():
        raised = details.get("ctx", {}).get("error")
        if isinstance(raised, InputError):  # a whole sentence, of something beside the file
            whole.append(str(raised))
            continue
        key, found, expected, field = _explain(model, data, details)
        by_value.setdefault((key, found), []).append(expected)
        meaning[key] = field.description or "" if field else ""
    # Each branch of a union refuses the same value: together they are one sentence.
    by_key = (
        sentence(path, key, found, meaning[key] if len(expected) > 1 else expected[0])
        for (key, found), expected in by_value.items()
    )
    return "\n".join((*dict.fromkeys(whole), *by_key))


def _explain(
    model: type[BaseModel], data: Mapping[str, Any], details: ErrorDetails
) -> tuple[str, str, str, FieldInfo | None]:
    """Return the key, what was found there, what was expected, and the field."""
    context = details.get("ctx", {})
    path, field, owner = _follow(model, details["loc"])
    if context.get("key"):
        parts = str(context["key"]).split(".")
        below = [int(part) - 1 if part.isdigit() else part for part in parts]
        path, field, owner = _follow(model, [*path, *below])
    value = _value(data, path)
    found = "nothing" if value is _NOTHING else show(value)
    kind = details["type"]
    if kind == "refused":
        found = context["found"] or found
        expected = str(context["expected"])
    elif kind == "extra_forbidden":
        names = ", ".join(owner.model_fields)
        found, expected = f"an unknown key with the value {found}", f"one of {names}"
    elif kind in _BOUNDS:
        expected = _with_meaning(_BOUNDS[kind][0].format(**context), field)
    elif kind == "literal_error":
        expected = str(context["expected"]).replace("'", '"')
    elif kind in _KINDS and value is not _NOTHING and not isinstance(value, list):
        expected = _with_meaning(_KINDS[kind], field)
    else:  # missing, wrong length or wrong kind of container: say what belongs there
        expected = field.description if field and field.description else f"a table [{path[-1]}]"
    # Entries of a list are counted from 1, as in the keys of `prismid design --change`.
    named = (str(part + 1) if isinstance(part, int) else part for part in path)
    return ".".join(named), found, expected, field


def _with_meaning(kind: str, field: FieldInfo | None) -> str:
    return f"{kind} ({field.description})" if field and field.description else kind


def _follow(
    model: type[BaseModel], location: Sequence[str | int]
) -> tuple[list[str | int], FieldInfo | None, type[BaseModel]]:
    """Return the part of a location that is a key of the file, the field there, and its owner."""
    path: list[str | int] = []
    field: FieldInfo | None = None
    owner = model
    current: type[BaseModel] | None = model
    named = False
    for part in location:
        if current is None:
            if named:  # the name of one of several numbers, as in [extensions]
                path.append(part)
            break
        if named:
            # The name of one of several tables, as in [solver.profiles.NAME].
            named = False
        elif isinstance(part, str):
            owner = current
            field = current.model_fields.get(part)
            current = next(_models(field.annotation), None) if field else None
            named = field is not None and get_origin(field.annotation) is dict
        path.append(part)
    return path, field, owner


def _models(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and not isinstance(annotation, types.GenericAlias):
        if issubclass(annotation, BaseModel):
            yield annotation
        return
    for argument in get_args(annotation):
        yield from _models(argument)


_NOTHING = object()


def _value(data: Any, path: Sequence[str | int]) -> Any:
    """Return what stands at a key of the file, or `_NOTHING`."""
    for part in path:
        try:
            data = data[part]
        except (KeyError, IndexError, TypeError):
            return _NOTHING
    return data
