"""Which stages of a run are finished, as `stages.json` tells it."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import NotRequired, TypedDict

from driver.case.model import Case
from driver.common.atomic_write import write_whole
from driver.common.errors import InputError, sentence
from driver.results.files import STAGES


class Done(TypedDict):
    """What is kept of a finished stage.

    Its key, what it depends on by name with a hash each, names of its results, the hashes of their
    content, when it ended, how long it took, the file of its case from here, and on what machine.
    """

    key: str
    inputs: NotRequired[dict[str, str]]
    outputs: list[str]
    digests: NotRequired[dict[str, str]]
    finished: str
    seconds: float
    case: NotRequired[str]
    machine: NotRequired[str]


Record = dict[str, Done]


def read_record(results: Path) -> Record:
    """Return the finished stages by name, as `stages.json` tells them."""
    path = results / STAGES
    if not path.is_file():
        return {}
    try:
        record: Record = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError):
        record = {}
    # A damaged record is no record: the stages are run again.
    whole = isinstance(record, dict) and all(map(_is_entry, record.values()))
    return record if whole else {}


def _is_entry(entry: object) -> bool:
    return (
        isinstance(entry, dict)
        and isinstance(entry.get("key"), str)
        and isinstance(entry.get("outputs"), list)
        and all(map(_is_result, entry["outputs"]))
        and _are_texts(entry.get("inputs", {}))
        and _are_texts(entry.get("digests", {}))
        and all(map(_is_result, entry.get("digests", {})))
        and isinstance(entry.get("finished", ""), str)
        and isinstance(entry.get("seconds"), int | float)
        and isinstance(entry.get("case", ""), str)
        and isinstance(entry.get("machine", ""), str)
    )


def _are_texts(table: object) -> bool:
    return isinstance(table, dict) and all(isinstance(text, str) for text in table.values())


def _is_result(name: object) -> bool:
    """Whether a name is that of a file below the results.

    Those of a stage may be renamed or removed, and the record may come from anywhere.
    """
    return (
        isinstance(name, str)
        and "\0" not in name
        and name not in ("", ".")
        and not Path(name).is_absolute()
        and ".." not in Path(name).parts
    )


def case_from(results: Path, case: Case) -> str:
    """Return the path of a case file from its results: both may be moved together."""
    return os.path.relpath(case.file.resolve(), results.resolve())


def refuse_another_case(results: Path, case: Case) -> None:
    """Refuse results of another case, which those of this one would replace.

    Raises:
        InputError: they are of a case that is still there.
    """
    own = case_from(results, case)
    for name in {entry.get("case", own) for entry in read_record(results).values()} - {own}:
        other = Path(os.path.normpath(results.resolve() / name))
        try:
            is_another = other.is_file() and not other.samefile(case.file)
        except (OSError, ValueError):
            continue
        if is_another:
            raise InputError(
                sentence(
                    results, "folder", f"results of {other}",
                    'its own for each case: `results = "NAME"` under [execution] of one of them, '
                    "or `--results FOLDER`",
                )
            )  # fmt: skip


def write_record(results: Path, record: Record) -> None:
    """Write the finished stages by name, whole or not at all."""
    write_whole(results / STAGES, json.dumps(record, indent=2) + "\n")
