"""Processes of their own on one store, with CalculiX behind a script that counts its runs."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from driver.case.grains import Grain
from driver.case.history import HistoryTable
from driver.case.inference import Identification
from driver.case.loading import Boundary
from driver.case.material import MaterialTable
from driver.case.model import Case, write_case
from driver.case.solver import Execution, Solver
from driver.case.specimen import Specimen
from driver.results.hdf5 import read_hdf5
from meshes.arrays import FloatArray
from tests.solver_adapters.calculix.runs import needs_ccx

pytestmark = needs_ccx
ROOT = Path(__file__).parents[3]
# Notes its folder, and waits as long as there is a file "closed".
SCRIPT = """#!/bin/sh
case "$*" in
  *-v*) ;;
  *) pwd >> "$LABORATORY/runs"
     while [ -e "$LABORATORY/closed" ]; do sleep 0.05; done ;;
esac
exec "$CCX" "$@"
"""
DRIVER = """
import sys
from pathlib import Path
import numpy as np
from solver_adapters.calculix.adapter import CalculixAdapter
from tests.solver_adapters.calculix.runs import simulation

def tell(progress):
    if progress.holder:
        Path(sys.argv[2]).with_suffix(".waits").touch()

forces = [
    CalculixAdapter().solve(simulation((0.001, 0.0005 * k)), Path(sys.argv[1]), tell).force
    for k in range(int(sys.argv[3]))
]
np.save(sys.argv[2], forces)
"""


@dataclass
class Laboratory:
    """A folder with a store, the script in the place of `ccx`, and the processes at work."""

    folder: Path
    started: list[subprocess.Popen[bytes]] = field(default_factory=list)

    @property
    def store(self) -> Path:
        return self.folder / "Läger of jobs"

    def start(self, *command: str) -> subprocess.Popen[bytes]:
        found = os.environ["PATH"]
        path = f"{self.folder / 'bin'}{os.pathsep}{found}"
        more = {"PATH": path, "LABORATORY": str(self.folder), "CCX": shutil.which("ccx") or ""}
        process = subprocess.Popen([sys.executable, *command], cwd=ROOT, env=os.environ | more)
        self.started.append(process)
        return process

    def drive(self, name: str, jobs: int = 1) -> subprocess.Popen[bytes]:
        """A process that solves some simulations, one after the other."""
        answers = self.folder / f"{name}.npy"
        return self.start("-c", DRIVER, str(self.store), str(answers), str(jobs))

    def prismid(self, *words: str) -> subprocess.Popen[bytes]:
        return self.start("-m", "driver.cli", *words)

    def answer(self, name: str) -> FloatArray:
        return np.asarray(np.load(self.folder / f"{name}.npy"))

    def runs(self) -> list[str]:
        """Folders in which the program was started."""
        noted = self.folder / "runs"
        return noted.read_text("utf-8").splitlines() if noted.exists() else []

    def jobs(self) -> list[str]:
        return sorted(path.name for path in self.store.iterdir())

    def close(self) -> None:
        """Let the program wait at its beginning."""
        (self.folder / "closed").touch()

    def open(self) -> None:
        (self.folder / "closed").unlink()


def until(what: Callable[[], object], process: subprocess.Popen[bytes]) -> None:
    """Wait for something that a process will do."""
    while not what():
        assert process.poll() is None, "it has ended"
        time.sleep(0.05)


@pytest.fixture
def laboratory(tmp_path: Path) -> Iterator[Laboratory]:
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin" / "ccx").write_text(SCRIPT)
    (tmp_path / "bin" / "ccx").chmod(0o755)
    made = Laboratory(tmp_path)
    yield made
    for process in made.started:
        process.kill()
        process.wait()


def test_two_drivers_at_once_run_each_job_once_and_have_the_same_numbers(
    laboratory: Laboratory,
) -> None:
    both = [laboratory.drive(name, jobs=4) for name in "ab"]
    assert [process.wait() for process in both] == [0, 0]
    assert len(laboratory.runs()) == len(laboratory.jobs()) == 4
    np.testing.assert_array_equal(laboratory.answer("a"), laboratory.answer("b"))
    assert np.ptp(laboratory.answer("a")) > 100


def test_a_driver_that_is_killed_as_it_computes_leaves_its_job_to_the_one_that_waits(
    laboratory: Laboratory,
) -> None:
    laboratory.close()
    first = laboratory.drive("a")
    until(laboratory.runs, first)
    second = laboratory.drive("b")
    until((laboratory.folder / "b.waits").exists, second)
    first.send_signal(signal.SIGKILL)
    first.wait()
    laboratory.open()
    assert second.wait() == 0
    assert len(laboratory.runs()) == 2 and len(set(laboratory.runs())) == 2
    (job,) = laboratory.jobs()
    assert len(job) == 64
    assert laboratory.drive("c").wait() == 0 and len(laboratory.runs()) == 2
    np.testing.assert_array_equal(laboratory.answer("b"), laboratory.answer("c"))


def test_ctrl_c_ends_the_wait_for_another_driver_which_goes_on(laboratory: Laboratory) -> None:
    laboratory.close()
    first = laboratory.drive("a")
    until(laboratory.runs, first)
    second = laboratory.drive("b")
    until((laboratory.folder / "b.waits").exists, second)
    second.send_signal(signal.SIGINT)
    assert second.wait() != 0
    laboratory.open()
    assert first.wait() == 0 and len(laboratory.runs()) == 1


def test_a_truncated_result_is_named_by_verify_and_used_by_no_run(laboratory: Laboratory) -> None:
    assert laboratory.drive("a").wait() == 0
    assert laboratory.prismid("cache", "verify", str(laboratory.store)).wait() == 0
    (job,) = laboratory.jobs()
    for name in ("response.h5", "job.dat"):
        whole = (laboratory.store / job / name).read_bytes()
        (laboratory.store / job / name).write_bytes(whole[: len(whole) // 2])
    assert laboratory.prismid("cache", "verify", str(laboratory.store)).wait() == 1
    assert laboratory.drive("b").wait() == 0
    assert len(laboratory.runs()) == 2
    np.testing.assert_array_equal(laboratory.answer("a"), laboratory.answer("b"))
    assert laboratory.jobs() == [job, f"{job}.damaged-1"]


def test_prune_leaves_the_job_that_another_process_computes(laboratory: Laboratory) -> None:
    assert laboratory.drive("a").wait() == 0
    (done,) = laboratory.jobs()
    laboratory.close()
    driver = laboratory.drive("b", jobs=2)
    until(lambda: len(laboratory.runs()) == 2, driver)
    prune = "cache", "prune", str(laboratory.store), "--older-than", "0", "--yes"
    assert laboratory.prismid(*prune).wait() == 0
    assert not (laboratory.store / done).exists() and Path(laboratory.runs()[-1]).is_dir()
    laboratory.open()
    assert driver.wait() == 0
    (other,) = laboratory.jobs()
    assert len(other) == 64 and other != done


def case() -> Case:
    """One grain, loads alone, one parameter of the law, and a single iteration."""
    return Case(
        specimen=Specimen(length_um=6.0, cells="tet10", mesh_size_um=5.0, fine_mesh_size_um=3.5),
        grains=(Grain(name="grain", euler_deg=(281.0, 8.0, 47.0)),),
        material=MaterialTable(strain_measure="small", tau0_MPa=30.0, tau0_112=1e9),
        history=HistoryTable(file="history.csv"),
        boundary=Boundary(motion="stage", stage_ratio=4.5e-4, stage_ratio_uncertainty=2e-5),
        identification=Identification(parameters=("tau0",), max_iterations=1),
        solver=Solver(name="calculix", integration="backward_euler"),
        execution=Execution(processes=1, store="../Läger of jobs"),
    )


@pytest.mark.slow
def test_two_runs_of_cases_with_the_same_simulations_share_them_to_the_last_digit(
    laboratory: Laboratory,
) -> None:
    rows = ("0,0,,0", "60,20,,0.3", "120,40,,0.52", "180,60,,0.6", "240,45,,0.4")
    runs = []
    for name in "ab":
        folder = laboratory.folder / name
        folder.mkdir()
        (folder / "history.csv").write_text("\n".join(("time_s,stage_um,image,force_N", *rows)))
        write_case(case(), folder / "case.toml")
        runs.append(laboratory.prismid("run", str(folder), "--until", "identify"))
    assert [run.wait() for run in runs] == [0, 0]
    assert len(laboratory.runs()) == len(laboratory.jobs()) > 20
    a, b = (read_hdf5(laboratory.folder / name / "results" / "identify.h5") for name in "ab")
    assert a.keys() == b.keys()
    for name in a:
        np.testing.assert_array_equal(a[name], b[name])
    assert not (laboratory.folder / "a" / "results" / "jobs").exists()
