"""A program is known by what it says of its version, or by its files."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import psutil
import pytest

from solver_adapters.interface import PreparedError
from solver_adapters.jobs import identity
from solver_adapters.jobs.errors import JobError, is_by_circumstances
from solver_adapters.jobs.identity import NoAnswerError, hash_of, told_by
from solver_adapters.jobs.status import Status
from solver_adapters.profile import Profile
from tests.solver_adapters.bar import SIMULATION, BarAdapter


def script(path: Path, text: str) -> Path:
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)
    return path


class _Told(BarAdapter):
    version_call = ("--version",)

    def version_in(self, answer: str) -> str | None:
        name, _, number = answer.strip().rpartition(" ")
        return f"bar {number}" if name == "This is bar" else None


def adapter(program: Path) -> _Told:
    return _Told(Profile(command=(str(program),)))


def test_a_program_that_tells_its_version_is_known_by_it(tmp_path: Path) -> None:
    program = script(tmp_path / "bar", '[ "$1" = --version ] && echo This is bar 15.2')
    assert adapter(program).version() == "bar 15.2"


def test_a_launcher_that_is_the_same_for_two_versions_tells_them_apart(tmp_path: Path) -> None:
    versions = []
    for number in ("15.2", "17.3"):
        folder = tmp_path / number
        folder.mkdir()
        script(folder / "behind", f"echo This is bar {number}")
        versions.append(adapter(script(folder / "bar", '"$(dirname "$0")/behind"')).version())
    assert versions == ["bar 15.2", "bar 17.3"]


def test_a_program_that_was_replaced_is_asked_again(tmp_path: Path) -> None:
    program = script(tmp_path / "bar", "echo This is bar 1")
    first = adapter(program).version()
    script(program, "echo This is bar 2.0")
    assert (first, adapter(program).version()) == ("bar 1", "bar 2.0")


@pytest.mark.parametrize("text", ["echo libaster.so: cannot open shared object file >&2", "exit 3"])
def test_a_program_that_cannot_tell_is_a_broken_installation(tmp_path: Path, text: str) -> None:
    program = script(tmp_path / "bar", text)
    with pytest.raises(JobError) as error:
        adapter(program).version()
    assert error.value.status is Status.BROKEN and is_by_circumstances(error.value)
    assert f"found no version in the answer to {program} --version" in str(error.value)
    assert ("cannot open" in str(error.value)) == ("cannot open" in text)


def test_a_file_that_is_no_program_gives_no_answer(tmp_path: Path) -> None:
    (tmp_path / "bar").write_text("no program")
    with pytest.raises(NoAnswerError, match="Permission denied"):
        told_by((str(tmp_path / "bar"), "--version"))


def test_a_hash_knows_the_program_and_the_files_that_it_is_called_with(tmp_path: Path) -> None:
    tool, settings = script(tmp_path / "tool", "exit 0"), tmp_path / "settings"
    settings.write_text("a")
    first = hash_of((str(tool), str(settings)))
    assert first.startswith("tool ")
    settings.write_text("another")
    second = hash_of((str(tool), str(settings)))
    assert len({first, second, hash_of((str(tool), "-x")), hash_of((sys.executable,))}) == 4


def test_a_program_is_asked_in_a_folder_without_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "re.py").write_text("raise SystemExit")
    monkeypatch.chdir(tmp_path)
    program = script(tmp_path / "bar", 'ls; echo "This is bar 3"')
    assert told_by((str(program), "--version")) == "This is bar 3\n"


def test_a_program_that_hangs_is_ended_with_its_children(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(identity, "_LONGEST", 0.5)
    program = script(tmp_path / "bar", f"sleep 3333 & echo $! > {tmp_path}/child; wait")
    with pytest.raises(NoAnswerError, match="no answer within"):
        told_by((str(program), "--version"))
    child = int((tmp_path / "child").read_text())
    deadline = time.monotonic() + 10
    while _runs(child):
        assert time.monotonic() < deadline
        time.sleep(0.05)


def _runs(pid: int) -> bool:
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def test_a_broken_program_here_is_no_reason_not_to_prepare_a_job_for_elsewhere(
    tmp_path: Path,
) -> None:
    program = script(tmp_path / "bar", "exit 3")
    prepared = _Told(Profile(command=(str(program),), prepare_only=True))
    with pytest.raises(PreparedError):
        prepared.solve(SIMULATION, tmp_path / "jobs")
