"""A word where a long step says none."""

from __future__ import annotations

import time

import pytest

from driver.terminal import silence as module
from driver.terminal.silence import Silence


@pytest.mark.parametrize(
    ("compiling", "told"),
    [(True, "compiling numerical kernels, once on this machine"), (False, "at work")],
)
def test_a_long_step_is_told_again_and_again_with_what_it_is(
    compiling: bool, told: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "compiling", lambda: compiling)
    lines: list[str] = []
    with Silence(0.05).told(lines.append):
        time.sleep(0.5)
    assert len(lines) > 2 and all(line.startswith(f"    {told}, no other") for line in lines)


def test_nothing_is_said_while_others_speak() -> None:
    lines: list[str] = []
    silence = Silence(0.5)
    with silence.told(lines.append):
        for _ in range(10):
            time.sleep(0.1)
            silence.broken()
    assert lines == []
