"""Two runs never work on the same results, and a dead one keeps nobody away."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from driver.common.errors import InputError
from driver.workflow.run_lock import BusyError, sole_run

HOLD = """
import sys, time
from pathlib import Path
from driver.workflow.run_lock import sole_run

with sole_run(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(600)
"""


def test_a_second_run_is_told_which_process_is_at_work(tmp_path: Path) -> None:
    holder = f"process {os.getpid()} on {socket.gethostname()}"
    with (
        sole_run(tmp_path),
        pytest.raises(BusyError, match=f"^{tmp_path}: another run, {holder}, is at work on it"),
        sole_run(tmp_path),
    ):
        pass


def test_a_run_that_has_ended_lets_the_next_one_in(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError, match="diverged"), sole_run(tmp_path):
        raise RuntimeError("diverged")
    with sole_run(tmp_path):
        pass


def test_a_run_that_was_killed_keeps_nobody_away(tmp_path: Path) -> None:
    command = [sys.executable, "-c", HOLD, str(tmp_path)]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, text=True, cwd=Path(__file__).parents[3]
    ) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "held\n"
        with pytest.raises(BusyError, match=f"process {other.pid} on"), sole_run(tmp_path):
            pass
        other.kill()
        other.wait()
    with sole_run(tmp_path):
        pass


def test_other_results_are_free(tmp_path: Path) -> None:
    other = tmp_path / "other"
    other.mkdir()
    with sole_run(tmp_path), sole_run(other):
        pass


def test_what_a_link_in_the_place_of_the_lock_leads_to_stays_as_it_is(tmp_path: Path) -> None:
    theirs = tmp_path / "theirs"
    theirs.write_text("theirs")
    (tmp_path / "run.lock").symlink_to(theirs)
    with (
        pytest.raises(InputError, match=f"^{tmp_path}/run.lock: file: found a link, expected a"),
        sole_run(tmp_path),
    ):
        pass
    assert theirs.read_text() == "theirs"
