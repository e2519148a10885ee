"""A run that is killed in the middle of a stage, and the next one."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from driver.case.model import load_case, write_case
from driver.common.progress import progress_to
from driver.forward import build
from driver.results.files import DIAGNOSIS, DIAGNOSIS_H5, IDENTIFY, kept_folder
from driver.results.hdf5 import read_hdf5
from driver.workflow import pipeline
from driver.workflow.engine import run_stages
from solver_adapters.interface import Progress, Response, Simulation
from tools import closed_form

ROOT = Path(__file__).parents[3]

pytestmark = pytest.mark.slow  # six runs of a stage, and two processes of their own


class Counting(closed_form.ClosedFormSolver):
    """The solver in closed form, which counts its runs and ends its process before one."""

    def __init__(self, fatal: int = 0) -> None:
        super().__init__(0.001)
        self.runs, self.fatal = 0, fatal

    def solve(
        self,
        simulation: Simulation,
        workspace: Path | None = None,
        progress: Callable[[Progress], None] | None = None,
    ) -> Response:
        self.runs += 1
        if self.runs == self.fatal:
            os.kill(os.getpid(), signal.SIGKILL)
        return super().solve(simulation, workspace, progress)


@dataclass
class Run:
    """What a run has said, and how many simulations it has made."""

    simulations: int
    lines: list[str] = field(default_factory=list)


def run(folder: Path, until: str, fatal: int = 0, force: bool = False) -> Run:
    case, solver, lines = load_case(folder / "case.toml"), Counting(fatal), list[str]()
    with pytest.MonkeyPatch.context() as patch, progress_to(lines.append):
        patch.setattr(build, "find_adapter", lambda name, profile: solver)
        run_stages(case, pipeline.stages(case), until, force)
    return Run(solver.runs, lines)


def kill(folder: Path, until: str, fatal: int) -> None:
    """Run in a process of its own, which is killed before a simulation."""
    call = f"from {__name__} import *; run(Path({str(folder)!r}), {until!r}, {fatal})"
    ended = subprocess.run([sys.executable, "-c", call], cwd=ROOT, check=False)
    assert ended.returncode == -signal.SIGKILL


@dataclass
class Both:
    """A case whose stages ran through, and one whose stages were killed once each."""

    whole: Path
    killed: Path
    whole_runs: dict[str, Run]
    resumed_runs: dict[str, Run]
    left: dict[str, int]


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> Both:
    whole = tmp_path_factory.mktemp("interruption") / "whole"
    whole.mkdir()
    closed_form.write_files(whole, {"stretch_curvature": 0.1, "tau0": 44.0})
    few = {"diagnosis.causes": ("stretch_not_proportional", "load_gain"), "diagnosis.refit": 1}
    write_case(load_case(whole / "case.toml").with_values_at(few), whole / "case.toml")
    run(whole, "measure")
    killed = whole.with_name("killed")
    shutil.copytree(whole, killed)
    found = Both(whole, killed, {}, {}, {})
    for stage in ("identify", "diagnose"):
        found.whole_runs[stage] = run(whole, stage)
        half = found.whole_runs[stage].simulations // 2 + 1
        kill(killed, stage, half)
        kept = sorted((killed / "results" / kept_folder(stage)).iterdir())
        found.left[stage] = len(kept)
        damaged = bytearray(kept[0].read_bytes())
        damaged[len(damaged) // 2] ^= 0xFF
        kept[0].write_bytes(damaged)
        kept[1].write_bytes(kept[1].read_bytes()[:1000])
        found.resumed_runs[stage] = run(killed, stage)
    return found


@pytest.mark.parametrize("stage", ["identify", "diagnose"])
def test_the_next_run_makes_what_is_left_and_what_is_damaged(both: Both, stage: str) -> None:
    whole, resumed, left = both.whole_runs[stage], both.resumed_runs[stage], both.left[stage]
    assert left > 5
    assert resumed.simulations == whole.simulations - left + 2
    log = "\n".join(resumed.lines)
    assert f"{left} simulations of an interrupted run are kept: those that come again are" in log
    # Refits say nothing of their own simulations.
    assert 0 < log.count("a simulation that was made before is taken up") <= left - 2
    assert not any("interrupted run" in line for line in whole.lines)


def test_its_numbers_are_those_of_a_run_that_was_not_killed(both: Both) -> None:
    first, second = both.whole / "results", both.killed / "results"
    for name in (IDENTIFY, DIAGNOSIS_H5):
        expected, found = read_hdf5(first / name), read_hdf5(second / name)
        assert expected.keys() == found.keys()
        for key, values in expected.items():
            np.testing.assert_array_equal(found[key], values, err_msg=f"{name}/{key}")
    texts = [json.loads((folder / DIAGNOSIS).read_text("utf-8")) for folder in (first, second)]
    assert texts[0] == texts[1]


def test_nothing_is_kept_of_a_stage_that_has_ended(both: Both) -> None:
    assert not list(both.killed.glob("results/*.kept"))


def test_a_forced_run_takes_nothing_up_and_no_link_is_followed(both: Both, tmp_path: Path) -> None:
    folder = tmp_path / "case"
    shutil.copytree(both.whole, folder)
    kept = folder / "results" / kept_folder("identify")
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "mine.npz").write_bytes(b"mine")
    kept.symlink_to(elsewhere)
    (folder / "results" / IDENTIFY).unlink()
    again = run(folder, "identify")
    assert again.simulations == both.whole_runs["identify"].simulations
    assert [path.name for path in elsewhere.iterdir()] == ["mine.npz"]
    assert not kept.is_symlink()
