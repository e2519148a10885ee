"""Reading tables from a TOML file, each thing wrong with it told in one sentence."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from driver.case.messages import sentences
from driver.common.errors import InputError, sentence, why

Tables = TypeVar("Tables", bound=BaseModel)

_TOO_DEEP = "tables nested too deep"
_DEEPEST = 50  # tables and lists within each other, of which a case has four
_TWICE = "Cannot overwrite a value"  # as tomllib has it, before the place


def read_toml(path: Path, expected: str, refuse: type[InputError] = InputError) -> dict[str, Any]:
    """Return the content of a TOML file.

    Args:
        path: the file.
        expected: what it is, told where it is absent.
        refuse: the error that is raised.

    Raises:
        InputError: it is absent, cannot be read, or is no TOML in UTF-8.
    """
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise refuse(sentence(path, "file", "no regular file", expected))
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except FileNotFoundError:
        raise refuse(sentence(path, "file", "nothing", expected)) from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise refuse(no_toml(path, error)) from None
    except RecursionError:
        raise refuse(sentence(path, "file", _TOO_DEEP, "a TOML file")) from None
    except (OSError, ValueError) as error:
        raise refuse(sentence(path, "file", why(error), "a TOML file that can be read")) from None
    if _depth(content) > _DEEPEST:
        raise refuse(sentence(path, "file", _TOO_DEEP, "a TOML file"))
    return content


def _depth(content: Any) -> int:
    """Return how many tables and lists lie within each other."""
    depth, inside = 0, [content]
    while inside:
        depth += 1
        values = [v for c in inside for v in (c.values() if isinstance(c, dict) else c)]
        inside = [value for value in values if isinstance(value, dict | list)]
    return depth


def no_toml(path: Path, error: tomllib.TOMLDecodeError | UnicodeDecodeError) -> str:
    """Return the sentence for a file whose text is no TOML."""
    message = str(error)
    if message.startswith(_TWICE):
        return sentence(path, "file", f"a key twice{message.removeprefix(_TWICE)}", "each key once")
    return sentence(path, "file", f"“{message}”", "a TOML file in UTF-8")


def read_tables(path: Path, model: type[Tables], expected: str) -> Tables:
    """Return the tables of a TOML file, validated.

    Args:
        path: the file.
        model: what it holds.
        expected: what it is, told where it is absent.

    Raises:
        InputError: the file cannot be read, or a key is unknown, absent or out of range.
    """
    data = read_toml(path, expected)
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise InputError(sentences(path, model, data, error)) from None
