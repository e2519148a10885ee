"""A process of its own reads what would end this one."""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

import pytest

from meshes import guarded
from meshes.guarded import can_be_read

HERE = "tests.meshes.test_guarded"


def end_by_signal(path: str) -> None:
    os.abort()


def never_come_back(path: str) -> None:
    time.sleep(1e6)


def take_all_memory(path: str) -> None:
    bytearray(64_000_000_000)


def refuse(path: str, word: str) -> None:
    print("printed by a library")
    raise SystemExit(word)


def test_what_ends_the_process_cannot_be_read_and_the_next_file_can(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"a")
    assert not can_be_read(f"{HERE}:end_by_signal", path)
    assert can_be_read(f"{HERE}:refuse", path, "no")


def test_what_takes_all_memory_or_never_comes_back_cannot_be_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"a")
    assert not can_be_read(f"{HERE}:take_all_memory", path)
    monkeypatch.setattr(guarded, "_SECONDS", 0.5)
    assert not can_be_read(f"{HERE}:never_come_back", path)


def test_a_file_is_tried_again_where_it_has_changed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, asked = tmp_path / "a", list[bytes]()
    path.write_bytes(b"a")

    def outcome(request: bytes, seconds: float) -> bool:
        asked.append(request)
        return True

    monkeypatch.setattr(guarded._TRIALS, "outcome", outcome)
    for content in (b"a", b"a", b"ab"):
        if path.read_bytes() != content:
            path.write_bytes(content)
        assert can_be_read("any:reader", path)
    assert len(asked) == 2


def test_a_file_that_is_not_there_is_told_by_whoever_reads_it(tmp_path: Path) -> None:
    assert can_be_read("any:reader", tmp_path / "a")


def test_a_process_that_cannot_be_started_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "a").write_bytes(b"a")
    monkeypatch.setattr(guarded, "_TRIALS", guarded._Trials())
    monkeypatch.setattr(sys, "executable", "/bin/false")
    with pytest.raises(OSError, match="no process that reads files first"):
        can_be_read("any:reader", tmp_path / "a")
