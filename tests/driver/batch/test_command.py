"""Campaigns as a user runs them, to the first stage."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import pytest
from typer.testing import CliRunner

from driver.batch.command import batch
from driver.batch.progress import State
from driver.cli import app
from driver.common.errors import InputError
from driver.workflow.run_lock import sole_run
from solver_adapters.kernels import PACKAGES
from tests.driver.batch.cases import rows, write_small_case

CAMPAIGN = """
cases = ["*/case.toml"]
until = "mesh"
[[study]]
case = "good/case.toml"
values."specimen.length_um" = [9.0]
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    write_small_case(tmp_path / "good")
    (tmp_path / "bad").mkdir()
    (tmp_path / "bad" / "case.toml").write_text("[specimen]\nlength_um = -1.0\n")
    made = tmp_path / "campaign.toml"
    made.write_text(CAMPAIGN)
    return made


def test_a_case_that_fails_is_told_and_the_others_go_on(file: Path, lines: list[str]) -> None:
    seen: list[list[str]] = []

    def watch(states: Sequence[State], at_a_time: int) -> None:
        seen.append([state.status for state in states])

    assert not batch(file, watch)
    statuses = {name: row["status"] for name, row in rows(file).items()}
    assert statuses == {"bad": "failed", "good": "done", "good specimen.length_um=9.0": "done"}
    assert "specimen.length_um: found -1.0, expected a number > 0" in rows(file)["bad"]["why"]
    assert lines[0].startswith("3 cases, ") and "at a time on" in lines[0]
    assert any(line.startswith("bad: failed after") for line in lines)
    assert any(line.startswith("good: done after") for line in lines)
    assert seen[-1] == ["failed", "done", "done"]
    assert (file.parent / "good" / "results" / "mesh.med").is_file()
    assert not list(file.with_suffix(".batch").glob("running*"))


def test_a_store_that_cannot_be_made_is_refused_before_a_case_begins(file: Path) -> None:
    file.write_text(CAMPAIGN + '[execution]\nstore = "campaign.toml"\n')
    with pytest.raises(InputError, match=f"^{file}: execution.store: found .* expected a folder"):
        batch(file, lambda states, at_a_time: None)
    assert not (file.parent / "good" / "results").exists()


def test_what_is_done_is_not_done_again_and_the_exit_code_tells_the_outcome(file: Path) -> None:
    file.write_text('cases = ["*/case.toml"]\nuntil = "mesh"\n')
    assert CliRunner().invoke(app, ["batch", str(file)]).exit_code == 1
    before = (file.parent / "good" / "results" / "mesh.med").stat().st_mtime_ns
    (file.parent / "bad" / "case.toml").unlink()
    ended = CliRunner().invoke(app, ["batch", str(file)])
    assert ended.exit_code == 0 and "summary.html" in ended.output
    assert (file.parent / "good" / "results" / "mesh.med").stat().st_mtime_ns == before
    assert "mesh: done and unchanged" in (
        (file.with_suffix(".batch") / "logs" / "good.log").read_text("utf-8")
    )


def test_a_campaign_is_run_once_at_a_time(file: Path) -> None:
    folder = file.with_suffix(".batch")
    folder.mkdir()
    with (
        sole_run(folder),
        pytest.raises(InputError, match="another run"),
    ):
        batch(file, lambda states, at_a_time: None)


def test_ctrl_c_stops_all_jobs_and_the_next_run_goes_on(file: Path) -> None:
    (file.parent / "bad" / "case.toml").unlink()
    file.write_text(
        'until = "mesh"\n[[trial]]\ncase = "good/case.toml"\nsettings = "s.toml"\nseeds = [1, 2]\n'
    )
    (file.parent / "s.toml").write_text("[program]\ncycles = [[20, 1]]\nlargest_strain = 0.01\n")
    run = subprocess.Popen(
        [sys.executable, "-m", "driver.cli", "batch", str(file)],
        env=os.environ | {"PYTHONPATH": str(PACKAGES)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    log = file.with_suffix(".batch") / "logs" / "good s seed 1.log"
    while not (log.is_file() and "truth on a mesh" in log.read_text("utf-8")):
        assert run.poll() is None
        time.sleep(0.05)
    os.killpg(run.pid, signal.SIGINT)
    said, complaints = run.communicate(timeout=300)
    assert run.returncode == 130 and "Traceback" not in complaints
    assert complaints == "prismid: stopped; finished stages are kept, run again to go on\n"
    assert not list(file.with_suffix(".batch").glob("good s seed */case.toml"))
    assert not list(file.with_suffix(".batch").glob("running*"))


def test_a_folder_that_is_removed_in_the_middle_stops_all_cases_and_is_told(file: Path) -> None:
    def remove(states: Sequence[State], at_a_time: int) -> None:
        shutil.rmtree(file.with_suffix(".batch"), ignore_errors=True)

    with pytest.raises(InputError, match="found nothing any more: all cases are stopped"):
        batch(file, remove)
    assert {row["status"] for row in rows(file).values()} <= {"stopped", "failed", "waiting"}


def test_a_case_that_is_taken_for_a_campaign_is_told_so(file: Path) -> None:
    with pytest.raises(InputError, match="case.toml: file: found a case, expected the file of a"):
        batch(file.parent / "good" / "case.toml", lambda states, at_a_time: None)
