"""The folder of a virtual experiment: whole or nothing, whoever has died in it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from driver.common.errors import InputError
from driver.virtual.place import refuse_what_is_there, whole_or_none

KILLED = """
import os, signal, sys
from pathlib import Path
from driver.virtual.place import whole_or_none
with whole_or_none(Path(sys.argv[1])) as aside:
    (aside / "images.tif").write_text("cut o")
    if len(sys.argv) > 2:
        (aside / "images.tif").replace(aside.parent / "images.tif")
    os.kill(os.getpid(), signal.SIGKILL)
"""


def write(folder: Path) -> None:
    with whole_or_none(folder) as aside:
        for name in ("case.toml", "images.tif", "history.csv"):
            (aside / name).write_text("whole")


@pytest.mark.parametrize("moved", [(), ("moved",)])
def test_what_a_killed_process_has_left_is_made_anew(tmp_path: Path, moved: tuple[str]) -> None:
    out = tmp_path / "out"
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    command = [sys.executable, "-c", KILLED, str(out), *moved]
    assert subprocess.run(command, env=environment, check=False).returncode == -signal.SIGKILL
    assert list(out.iterdir())
    refuse_what_is_there(out)
    write(out)
    assert {path.name for path in out.iterdir()} == {"case.toml", "images.tif", "history.csv"}
    assert (out / "images.tif").read_text() == "whole"
    with pytest.raises(InputError, match="--to: found something there"):
        write(out)


def test_a_folder_of_the_user_is_refused_and_stays(tmp_path: Path) -> None:
    (tmp_path / "images.tif").write_text("mine")
    with pytest.raises(InputError, match="--to: found something there"):
        write(tmp_path)
    assert (tmp_path / "images.tif").read_text() == "mine"


def test_two_processes_do_not_write_in_one_folder(tmp_path: Path) -> None:
    with whole_or_none(tmp_path / "out"):
        with pytest.raises(InputError, match="another process that writes there"):
            write(tmp_path / "out")


def test_one_that_is_stopped_while_its_files_are_moved_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, replace = tmp_path / "out", Path.replace

    def stopped(path: Path, target: Path) -> Path:
        if path.name == "case.toml":
            raise KeyboardInterrupt
        return replace(path, target)

    monkeypatch.setattr(Path, "replace", stopped)
    with pytest.raises(KeyboardInterrupt):
        write(out)
    assert list(out.iterdir()) == []
