"""What a case asks for is done once its user has agreed, and no longer than it stays the same."""

from __future__ import annotations

from pathlib import Path

import pytest

from driver.case.consent import (
    ConsentError,
    Request,
    agree,
    is_agreed,
    refuse_unless_agreed,
    trusted_path,
)
from driver.common.errors import InputError

COMMAND = Request("solver.profiles.bar.command", "a command", ("docker", "run", "bar"))


@pytest.fixture(autouse=True)
def config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.delenv("PRISMID_CONFIG", raising=False)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    return tmp_path / "config" / "prismid"


def test_nothing_is_agreed_to_beforehand_and_the_refusal_says_what_to_call() -> None:
    expected = (
        "^case.toml: solver.profiles.bar.command: found a command that you have not agreed to "
        r"\(docker run bar\), expected one that you have: `prismid trust case.toml` shows it and"
    )
    with pytest.raises(ConsentError, match=expected):
        refuse_unless_agreed(Path("case.toml"), [COMMAND])


def test_what_was_agreed_to_once_is_not_refused_again() -> None:
    agree([COMMAND])
    refuse_unless_agreed(Path("case.toml"), [COMMAND])
    refuse_unless_agreed(Path("other.toml"), [COMMAND])


def test_other_words_or_another_kind_are_other_requests() -> None:
    agree([COMMAND])
    assert not is_agreed(Request(COMMAND.key, COMMAND.kind, ("docker", "run", "baz")))
    assert not is_agreed(Request(COMMAND.key, COMMAND.kind, ("docker", "run bar")))
    assert not is_agreed(Request(COMMAND.key, "a scheduler", COMMAND.words))


def test_a_script_that_has_changed_is_asked_for_again(tmp_path: Path) -> None:
    script = tmp_path / "solve.sh"
    script.write_text("echo one")
    request = Request("key", "a command", ("sh", str(script)))
    agree([request])
    assert is_agreed(request)
    script.write_text("echo two")
    assert not is_agreed(request)


def test_control_characters_are_shown_as_such() -> None:
    request = Request("key", "a command", ("run\x1b[2J", "σ"))
    assert request.told == "run\\u001b[2J σ"


def test_what_is_agreed_to_later_leaves_the_earlier(config: Path) -> None:
    other = Request("execution.scheduler", "a scheduler", ("tcp://node:8786",))
    agree([COMMAND])
    agree([other])
    assert is_agreed(COMMAND) and is_agreed(other)
    assert trusted_path() == config / "trusted.json"
    assert sorted(path.name for path in config.iterdir()) == ["trusted.json"]


@pytest.mark.parametrize("damage", ["", "[]", "{}", '{"agreed": 3}', 3000 * "["])
def test_a_damaged_list_agrees_to_nothing_and_is_named(config: Path, damage: str) -> None:
    config.mkdir(parents=True)
    trusted_path().write_text(damage)
    with pytest.raises(InputError, match=f"^{trusted_path()}: file: found no list of hashes"):
        is_agreed(COMMAND)
