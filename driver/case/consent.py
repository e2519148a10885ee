"""What a case or a campaign may do on this machine only after its user has agreed, once.

A case comes from anywhere. What it makes stays in its folder by itself; a program that it calls,
a scheduler that it talks to and a link that leads elsewhere are its user's to allow.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from shlex import quote

from driver.common.atomic_write import write_whole
from driver.common.errors import InputError, sentence, why
from solver_adapters.profile import config_path

TRUSTED = "trusted.json"
"""What was agreed to, as hashes, beside the user's configuration."""
_AGREED = "agreed"


class ConsentError(InputError):
    """Something that nobody has agreed to."""


@dataclass(frozen=True)
class Request:
    """What is asked for.

    Attributes:
        key: where it stands: a key of a TOML file, or a folder.
        kind: what it is, in words, such as "a command".
        words: the command, the lines, the address or the folder.
    """

    key: str
    kind: str
    words: tuple[str, ...]

    @property
    def told(self) -> str:
        """The words as they are shown; control characters of a file never reach the terminal."""
        return " ".join(json.dumps(w)[1:-1] if not w.isprintable() else w for w in self.words)

    @property
    def digest(self) -> str:
        """Hash of what is done: the words, and the content of the files among them."""
        files = [_content(word) for word in self.words]
        return hashlib.sha256(json.dumps([self.kind, self.words, files]).encode()).hexdigest()


def _content(word: str) -> str:
    """Hash of the file that a word names by its absolute path; "" for any other word."""
    path = Path(word)
    try:
        if not path.is_absolute() or not path.is_file():
            return ""
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except (OSError, ValueError):
        return ""


def trusted_path() -> Path:
    """Return the file that holds what was agreed to on this machine."""
    return config_path().parent / TRUSTED


def is_agreed(request: Request) -> bool:
    """Whether the user has agreed to a request.

    Raises:
        InputError: the file that tells it is damaged.
    """
    return request.digest in _agreed()


def refuse_unless_agreed(file: Path, requests: Iterable[Request]) -> None:
    """Refuse what the user has not agreed to.

    Args:
        file: the case or the campaign that asks.
        requests: what it asks for.

    Raises:
        ConsentError: something was not agreed to; one sentence for each.
    """
    missing = [request for request in requests if not is_agreed(request)]
    if missing:
        raise ConsentError("\n".join(_refusal(file, request) for request in missing))


def _refusal(file: Path, request: Request) -> str:
    found = f"{request.kind} that you have not agreed to ({request.told})"
    expected = f"one that you have: `prismid trust {quote(str(file))}` shows it and asks"
    return sentence(file, request.key, found, expected)


def agree(requests: Sequence[Request]) -> None:
    """Keep that the user has agreed to requests.

    Raises:
        InputError: what was agreed to before is damaged, or nothing can be written there.
    """
    path, known = trusted_path(), _agreed()
    agreed = known | {request.digest: f"{request.kind}: {request.told}" for request in requests}
    text = json.dumps({_AGREED: agreed}, indent=1, ensure_ascii=False) + "\n"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, text)
    except OSError as error:
        raise InputError(sentence(path, "file", why(error), "one that can be written")) from None


def _agreed() -> dict[str, str]:
    """Return what was agreed to, in words, by its hash."""
    path = trusted_path()
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
        agreed: dict[str, str] = record[_AGREED]
        if not isinstance(agreed, dict):
            raise TypeError
    except FileNotFoundError:
        return {}
    except OSError as error:
        raise InputError(sentence(path, "file", why(error), "one that can be read")) from None
    except (ValueError, KeyError, TypeError, RecursionError):
        found, expected = "no list of hashes", "one as `prismid trust` writes it: remove it"
        raise InputError(sentence(path, "file", found, expected)) from None
    return agreed
