"""Results as JSON: a text that people can read, without NaN and infinity."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from driver.common.atomic_write import write_whole
from driver.results.hdf5 import damaged


def read_json(path: Path) -> dict[str, Any]:
    """Read a record back.

    Raises:
        ResultError: the file is no readable JSON, or holds no record.
    """
    try:
        record: object = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise damaged(path, f"no readable JSON ({error})") from None
    if not isinstance(record, dict):
        raise damaged(path, "no record")
    return record


def write_json(path: Path, record: Mapping[str, Any], indent: int = 1) -> None:
    """Write a record, a value a line, whole or not at all."""
    write_whole(path, json.dumps(record, indent=indent, ensure_ascii=False) + "\n")


def json_number(value: float) -> float | None:
    """Return a number as JSON has it, which knows neither infinity nor NaN: they are None."""
    return float(value) if math.isfinite(value) else None
