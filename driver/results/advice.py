"""Which change of an experiment would part causes that its data cannot tell apart."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from driver.results.files import ADVICE
from driver.results.hdf5 import damaged
from driver.results.json_files import read_json, write_json


@dataclass(frozen=True)
class Advice:
    """What `advice.json` holds.

    Attributes:
        causes: the set of causes that cannot be told apart, or none.
        changes: name of each change ("" is the experiment as it was), and by how many standard
            deviations it would part them, the one that parts them most first.
        text: what to measure, in a sentence; empty where nothing is advised.
    """

    causes: tuple[str, ...]
    changes: tuple[tuple[str, float], ...]
    text: str


def write_advice(folder: Path, advice: Advice) -> None:
    """Write `advice.json`.

    Args:
        folder: where it goes.
        advice: what it holds.
    """
    changes = [{"change": name, "apart_sigma": apart} for name, apart in advice.changes]
    record = {"causes": list(advice.causes), "changes": changes, "text": advice.text}
    write_json(folder / ADVICE, record)


def read_advised_text(path: Path) -> str:
    """Read the sentence of an advice back.

    Raises:
        ResultError: the file is no readable JSON, or has no such entry.
    """
    record = read_json(path)
    if "text" not in record:
        raise damaged(path, "no entry text")
    return str(record["text"])
