"""The adapter with the program itself, where run_aster is on PATH; nothing here is a stub."""

from __future__ import annotations

import os
import signal
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import psutil
import pytest

from driver.forward.build import adapter_of, build_model, mesh_of
from driver.results.extended_decks import write_decks
from driver.results.files import DECKS
from driver.virtual.truth import stage_program
from solver_adapters.bundled.adapter import BundledAdapter
from solver_adapters.code_aster.adapter import CodeAsterAdapter
from solver_adapters.code_aster.listing import diagnose
from solver_adapters.external import Profile, Status
from solver_adapters.interface import PreparedError, Progress, Response, Simulation
from solver_adapters.jobs.errors import JobError
from solver_adapters.jobs.key import job_key
from tests.templates.golden_decks import CASES
from tools.code_aster_cases import small_case, three_grains
from tools.code_aster_runs import NAMES, simulation
from tools.short_specimen import small_case as short_specimen

ADAPTER = CodeAsterAdapter()
pytestmark = pytest.mark.skipif(
    ADAPTER.program() is None,
    reason="run_aster is not on PATH, so that nothing here meets the real program",
)
# Steps that end after minutes: the program is ended on its way.
LONG = replace(small_case(), steps_per_interval=400)


def adapter(**settings: object) -> CodeAsterAdapter:
    return CodeAsterAdapter(Profile(**{"wall_time": 600.0, **settings}))  # type: ignore[arg-type]


def agrees(asked: Simulation, found: Response) -> bool:
    """Whether the bundled solver answers the same at equal steps and Gauss points."""
    own = BundledAdapter().solve(replace(asked, steps=found.ends, tet10_points=5))
    force, motion = abs(own.force - found.force), abs(own.displacement - found.displacement)
    return bool(force.max() <= 1e-7 * abs(own.force).max() and motion.max() <= 1e-8)


def passing_folders() -> set[str]:
    return {name for name in os.listdir(tempfile.gettempdir()) if name.startswith("run_aster_")}


def test_the_program_tells_its_version() -> None:
    assert ADAPTER.version().startswith("code_aster 1")


@pytest.mark.parametrize(
    "name",
    [n if n in ("null", "all") else pytest.param(n, marks=pytest.mark.slow) for n in NAMES],
)
def test_every_term_of_the_law_runs_and_agrees(name: str, tmp_path: Path) -> None:
    asked = simulation(name)
    found = adapter().solve(asked, tmp_path)
    assert agrees(replace(asked, cell_fields=False), found)
    assert found.cells is not None and abs(found.cells.slip).max() > 1e-4


@pytest.mark.slow
@pytest.mark.parametrize("name", ["long", "steps", "divided", "free"])
def test_long_lists_recorded_steps_and_free_components_run_and_agree(
    name: str, tmp_path: Path
) -> None:
    asked = replace(CASES[name], tolerance=1e-9)
    assert agrees(asked, adapter().solve(asked, tmp_path))


@pytest.mark.slow
def test_three_grains_run_and_agree(tmp_path: Path) -> None:
    asked = three_grains()
    assert agrees(asked, adapter().solve(asked, tmp_path))


def test_the_instant_that_a_run_has_reached_is_told_while_it_runs(tmp_path: Path) -> None:
    told: list[Progress] = []

    def heed(state: Progress) -> None:
        told.append(state)
        if state.time > 0.1:
            raise InterruptedError

    with pytest.raises(InterruptedError):
        adapter().solve(LONG, tmp_path, heed)
    assert told[-1].remaining > 0 and list(tmp_path.iterdir()) == []


def _calculation(process: psutil.Process) -> bool:
    """The Python of the calculation, below the launcher and its shells."""
    line = process.cmdline()
    return "python" in Path(line[0]).name and any("job.comm" in word for word in line)


def _shell(process: psutil.Process) -> bool:
    """The shell by which the launcher starts it."""
    line = process.cmdline()
    return Path(line[0]).name == "sh" and any("job.comm" in word for word in line)


@pytest.mark.parametrize("kind", [_calculation, _shell])
def test_a_kill_is_told_as_one_and_leaves_nothing_behind(
    kind: Callable[[psutil.Process], bool], tmp_path: Path
) -> None:
    before = passing_folders()

    def kill() -> None:
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline:
            for process in psutil.Process().children(recursive=True):
                with suppress(psutil.Error, IndexError):
                    if kind(process):
                        process.send_signal(signal.SIGKILL)
                        return
            time.sleep(0.1)

    thread = threading.Thread(target=kill)
    thread.start()
    with pytest.raises(JobError) as error:
        adapter().solve(LONG, tmp_path)
    thread.join()
    assert error.value.status is Status.KILLED
    (folder,) = tmp_path.iterdir()
    assert folder.name.endswith(".killed") and not (folder / "run_aster").exists()
    assert passing_folders() == before


@pytest.mark.parametrize(
    ("limits", "status"),
    [
        ({"wall_time": 6.0}, Status.OUT_OF_TIME),
        ({"wall_time": 600.0, "memory": 60.0}, Status.OUT_OF_MEMORY),
    ],
    ids=["time", "memory"],
)
def test_a_limit_is_told_by_its_name_and_a_higher_one_has_the_same_key(
    limits: Mapping[str, float], status: Status, tmp_path: Path
) -> None:
    with pytest.raises(JobError) as error:
        adapter(**limits).solve(LONG, tmp_path)
    assert error.value.status is status
    (folder,) = tmp_path.iterdir()
    key = folder.name.partition(".")[0]
    higher = adapter(wall_time=900.0, memory=8000.0, threads=2)
    assert key == job_key(LONG, ADAPTER.name, ADAPTER.version(), higher.files(LONG))


def test_the_time_limit_of_the_program_itself_is_told_by_its_message(tmp_path: Path) -> None:
    """As a queue would set it: the export file has a limit, and nobody else watches."""
    for name, content in adapter(cpu_time=8.0).files(LONG).items():
        (tmp_path / name).write_bytes(content)
    command = ADAPTER.command(ADAPTER.program() or ())
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode != 0 and diagnose(done.stdout) is Status.OUT_OF_TIME
    assert ADAPTER.cause(done.stdout)


def test_a_deck_that_is_no_python_is_a_bad_deck_with_its_line(tmp_path: Path) -> None:
    class Spoiled(CodeAsterAdapter):
        def write(self, simulation: Simulation) -> Mapping[str, bytes]:
            files = dict(super().write(simulation))
            files["job.comm"] = files["job.comm"].replace(b"    0, 1, 2, 3,", b"    0, 1, 2, 3,,")
            return files

    with pytest.raises(JobError) as error:
        Spoiled(Profile(wall_time=600.0)).solve(small_case(), tmp_path)
    assert error.value.status is Status.BAD_DECK
    assert "SyntaxError" in error.value.quote and "0, 1, 2, 3,," in error.value.quote


def test_a_prepared_job_is_computed_by_hand_and_collected(tmp_path: Path) -> None:
    asked = small_case()
    with pytest.raises(PreparedError) as error:
        adapter(prepare_only=True).solve(asked, tmp_path)
    (folder,) = error.value.folders
    subprocess.run(["sh", "run.sh"], cwd=folder, check=True)
    assert not (folder / "run_aster").exists()
    found = adapter(command=("/path/to/no/tool",)).solve(asked, tmp_path)
    assert agrees(replace(asked, tolerance=1e-9), found)


@pytest.mark.slow
def test_an_extended_deck_runs_by_hand_as_it_was_written(tmp_path: Path) -> None:
    case = short_specimen()
    mesh, history = mesh_of(case, 6.0), stage_program([(2, 1)])
    model = build_model(case, mesh, history, np.zeros((0, 2)), adapter_of(case), 1)
    values = model.null_values() | {"tau0_grain2": 1.15, "elongation_1": 0.03}
    assert write_decks(tmp_path, case, model, values)["code_aster"] is None
    folder = tmp_path / DECKS / "code_aster"
    program = ADAPTER.program() or ()
    done = subprocess.run(
        [*program, "job.export"], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0 and diagnose(done.stdout) is Status.DONE
    asked = replace(model.simulation(values), integration="backward_euler", tolerance=1e-9)
    assert agrees(asked, ADAPTER.read(asked, folder))
