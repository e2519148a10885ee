"""Changes of a case: some of its keys, as nested tables, with other values."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from driver.case.grains import GIVES_WAY
from driver.case.messages import sentences
from driver.case.model import Case
from driver.common.errors import InputError


def changed_case(case: Case, change: Mapping[str, Any], path: Path, name: str) -> Case:
    """Return a case with a change, validated anew.

    Args:
        case: the case.
        change: nested keys of the case.
        path: where the change stands, to be told.
        name: what it is called there.

    Raises:
        InputError: a key is unknown or out of range.
    """
    whole = case.model_dump(mode="json")
    without_what_gives_way(whole["grains"], change.get("grains"))
    try:
        data = merged(whole, dict(change))
    except KeyError as error:
        raise InputError(
            f"{path}: {name}: found the entry {error.args[0]} of a list, expected one of its "
            "numbers, counted from 1"
        ) from None
    try:
        return Case.model_validate(data, context={"file": case.file})
    except ValidationError as error:
        raise InputError(sentences(path, Case, data, error)) from None


def without_what_gives_way(grains: list[dict[str, Any]], change: Any) -> None:
    """Leave out the map of a grain whose angles are stated anew, and the other way round.

    Args:
        grains: tables of the grains, which are changed.
        change: the keys that are stated anew, by the number of the grain from 1.
    """
    if not isinstance(change, dict):
        return
    for number, grain in enumerate(grains, start=1):
        stated = change.get(str(number))
        keys = stated if isinstance(stated, dict) else {}
        for other in {other for key in keys for other in GIVES_WAY.get(key, ())}.difference(keys):
            grain.pop(other, None)


def merged(whole: Any, change: Any) -> Any:
    """Return a table of the case with the keys of a change in it.

    A table laid over a list changes some of its entries, its keys are their numbers from 1:
    `grains.2.euler_deg`.

    Raises:
        KeyError: a list has no entry of that number.
    """
    if isinstance(whole, dict) and isinstance(change, dict):
        joined = {key: merged(whole[key], change[key]) for key in change if key in whole}
        return {**whole, **change, **joined}
    if isinstance(whole, list | tuple) and isinstance(change, dict):
        places = {str(number + 1): number for number in range(len(whole))}
        entries = list(whole)
        for key, value in change.items():
            if key not in places:
                raise KeyError(key)
            entries[places[key]] = merged(entries[places[key]], value)
        return entries
    return change


def label(change: dict[str, Any]) -> str:
    """Return a change in one line, as it could be given on the command line."""
    return "; ".join(f"{key}={value}" for key, value in _leaves(change))


def _leaves(table: dict[str, Any], above: Sequence[str] = ()) -> list[tuple[str, str]]:
    leaves: list[tuple[str, str]] = []
    for key, value in table.items():
        if isinstance(value, dict):
            leaves += _leaves(value, (*above, key))
        else:
            leaves.append((".".join((*above, key)), json.dumps(value, ensure_ascii=False)))
    return leaves
