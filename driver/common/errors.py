"""Bad input, told in one sentence: where, what was found, what was expected."""

from __future__ import annotations

import json
from collections.abc import Sequence
from difflib import get_close_matches
from pathlib import Path


class InputError(ValueError):
    """An input that cannot be used; each line of the message is one sentence."""


def show(value: object) -> str:
    """Return a value as it would stand in a TOML file, cut to a length that fits a sentence."""
    text = json.dumps(value, default=str, ensure_ascii=False)
    return text if len(text) <= 80 else text[:77] + "…"


def sentence(path: Path, place: str, found: str, expected: str) -> str:
    """Return the one sentence about a bad input: file, key or row, what was found and expected."""
    return f"{path}: {place}: found {found}, expected {expected}"


def one_of(found: str, known: Sequence[str]) -> str:
    """Say what is expected in place of an unknown name: like ones, else all."""
    near = get_close_matches(found, known)
    if near:
        return f"{' or '.join(near)}, or another of the {len(known)} names in the documentation"
    return f"one of {', '.join(known)}"


def why(error: BaseException) -> str:
    """Return what the system or a library said, without the path that the sentence names anyway."""
    message = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return f"“{' '.join(message.split()) or type(error).__name__}”"
