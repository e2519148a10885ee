"""A Dask scheduler and its workers, as processes that talk over TCP."""

from __future__ import annotations

import math
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np
import psutil
import pytest

from driver.batch.command import batch
from driver.batch.progress import State
from driver.batch.workers import of_scheduler
from driver.case.model import load_case, write_case
from driver.check.command import check
from driver.common.errors import InputError
from driver.common.parallel import THREAD_VARIABLES, side_by_side
from driver.results.hdf5 import read_hdf5
from driver.virtual.command import virtual
from driver.workflow import pipeline
from tests.driver.batch.cases import agreed, rows, write_small_case
from tests.driver.batch.seen_calls import SeenCalls
from tests.support.dask_cluster import cluster

pytestmark = pytest.mark.usefixtures("willing")


@pytest.mark.slow
def test_jobs_are_carried_out_by_the_workers_and_one_that_is_killed_loses_none(
    tmp_path: Path, lines: list[str]
) -> None:
    write_small_case(tmp_path / "good")
    (tmp_path / "s.toml").write_text(
        "[program]\ncycles = [[3, 1]]\nlargest_strain = 0.005\n[discretisation]\n"
        "mesh_size_um = 0.9\n"
    )
    file = tmp_path / "campaign.toml"
    killed: list[int] = []
    with cluster(tmp_path, 2) as made:
        file.write_text(
            'until = "mesh"\n[[trial]]\ncase = "good/case.toml"\nsettings = "s.toml"\n'
            f'seeds = [1, 2, 3]\n[execution]\nscheduler = "{made.address}"\n'
        )

        def watch(states: Sequence[State], at_a_time: int) -> None:
            busy = [s for s in states if s.status == "running" and "truth" in s.words]
            if busy and not killed:
                victim = next(w for w in made.workers if psutil.Process(w.pid).children())
                killed.append(victim.pid)
                victim.kill()

        assert batch(file, watch)
        assert killed and sum(w.poll() is None for w in made.workers) == 1
    assert f"3 cases, 2 at a time on 2 core(s) on the workers of {made.address}" in lines[0]
    assert {row["status"] for row in rows(file).values()} == {"done"} and len(rows(file)) == 3


@pytest.mark.slow
def test_a_case_that_has_lost_all_its_workers_is_told_with_what_helps(
    tmp_path: Path,
) -> None:
    """As one that needs more memory than a worker has: it would take them all down."""
    write_small_case(tmp_path / "good")
    file = tmp_path / "campaign.toml"
    once = {"DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "0"}
    with cluster(tmp_path, 1, settings=once) as made:
        file.write_text(
            f'cases = ["good"]\nuntil = "mesh"\n[execution]\nscheduler = "{made.address}"\n'
        )
        with SeenCalls(file, lambda process, before: made.workers[0].kill()):
            assert not batch(file, lambda states, at_a_time: None)
    assert rows(file)["good"]["why"] == (
        "lost with each worker that was at work on it, 1 in all, most likely for want of memory or "
        "of time; run again to go on"
    )


@pytest.mark.slow
def test_a_case_or_its_tasks_on_a_worker_have_the_numbers_of_a_single_process_here(
    tmp_path: Path, lines: list[str]
) -> None:
    base = write_small_case(tmp_path / "base")
    few = {"identification.starts": 2, "identification.max_iterations": 2}
    write_case(load_case(base).with_values_at(few), base)
    (tmp_path / "s.toml").write_text(
        "[program]\ncycles = [[3, 1]]\nlargest_strain = 0.005\n[discretisation]\n"
        "mesh_size_um = 0.9\n"
    )
    virtual(base, tmp_path / "s.toml", tmp_path / "data", 1)
    for name in ("here", "there"):
        shutil.copytree(tmp_path / "data", tmp_path / name)
    seen: dict[int, tuple[int, str]] = {}  # threads of each process of the case, by its number

    def watch(states: Sequence[State], at_a_time: int) -> None:
        for case in psutil.Process(made.workers[0].pid).children():
            with suppress(psutil.Error):
                for process in case.children():
                    if any("spawn_main" in word for word in process.cmdline()):
                        limits = [process.environ()[name] for name in THREAD_VARIABLES]
                        seen[process.pid] = (case.pid, " ".join(limits))

    with cluster(tmp_path, 1, settings=dict.fromkeys(THREAD_VARIABLES, "7")) as made:
        there = tmp_path / "there.toml"
        there.write_text(
            'cases = ["there"]\nuntil = "identify"\n[execution]\nprocesses = 2\n'
            f'scheduler = "{made.address}"\n'
        )
        assert batch(there, watch)
        # The same case, whose starts go to the worker while its stages run here.
        named = {"execution.scheduler": made.address, "execution.processes": 2}
        shutil.copytree(tmp_path / "data", tmp_path / "tasks")
        path = tmp_path / "tasks" / "case.toml"
        write_case(load_case(path).with_values_at(named), path)
        (told,) = [f.message for f in check(path) if f.subject == "scheduler"]
        assert told.startswith(f"{made.address}: 1 worker(s), 1 thread(s)")
        (worker,) = made.processes
        before = worker.cpu_times().user
        pipeline.run(path, "identify")
        assert worker.cpu_times().user > before + 1
        # What is done and unchanged is not done again for another place to compute.
        write_case(load_case(path).with_values_at({"execution.processes": 1}), path)
        pipeline.run(path, "identify")
        assert lines[-1] == "identify: done and unchanged"
    (case,) = {case for case, _ in seen.values()}
    assert list(seen.values()) == 2 * [(case, "1 1 1")]
    here = tmp_path / "here.toml"
    here.write_text('cases = ["here"]\nuntil = "identify"\n')
    assert batch(here, lambda states, at_a_time: None)
    one, *others = (
        read_hdf5(tmp_path / name / "results" / "identify.h5")
        for name in ("here", "there", "tasks")
    )
    for where, other in zip(("there", "tasks"), others, strict=True):
        assert one.keys() == other.keys()
        for name, values in one.items():
            np.testing.assert_array_equal(other[name], values, err_msg=f"{where}: {name}")


def run(file: Path, told: Path) -> tuple[int, str]:
    """Exit code of the command, and what it says on standard error; the rest goes to a file."""
    with told.open("w", encoding="utf-8") as log:
        ended = subprocess.run(
            [sys.executable, "-u", "-m", "driver.cli", "batch", str(file)],
            env=os.environ | agreed(file),
            stdout=log,
            stderr=subprocess.PIPE,
            text=True,
            timeout=300,
        )
    return ended.returncode, ended.stderr


@pytest.mark.slow
def test_where_the_scheduler_dies_the_command_says_so_and_goes_on_with_another_one(
    tmp_path: Path,
) -> None:
    write_small_case(tmp_path / "good")
    file, told = tmp_path / "campaign.toml", tmp_path / "told.txt"
    with cluster(tmp_path, 1) as made:
        file.write_text(
            'until = "mesh"\n[[study]]\ncase = "good/case.toml"\n'
            'values."specimen.length_um" = [9.0, 10.0, 11.0]\n'
            f'[execution]\nscheduler = "{made.address}"\n'
        )

        def end(process: psutil.Process, before: int) -> None:
            if before == 1:
                process.suspend()  # it is in the middle of its work
                while "done after" not in told.read_text("utf-8"):
                    time.sleep(0.05)
                made.scheduler.kill()

        with SeenCalls(file, end) as calls:
            code, complaints = run(file, told)
        for process in calls.all:
            if process.is_running():
                process.resume()
    assert code == 1
    assert complaints == (
        f"prismid: {file}: execution.scheduler: found jobs on the workers of {made.address} lost, "
        "expected a scheduler that lives; run again to go on\n"
    )
    first, second = calls.of_case
    states = {name: row["status"] for name, row in rows(file).items()}
    assert sorted(states.values()) == ["done", "stopped", "waiting"] and states[first] == "done"
    mesh = file.with_suffix(".batch") / first / "results" / "mesh.med"
    whole = mesh.stat().st_mtime_ns
    with cluster(tmp_path, 1, port=int(made.address.rpartition(":")[2])):
        assert run(file, told) == (0, "")
    assert {row["status"] for row in rows(file).values()} == {"done"}
    assert mesh.stat().st_mtime_ns == whole


@pytest.mark.slow
def test_numbers_of_workers_are_those_of_this_process(tmp_path: Path) -> None:
    with cluster(tmp_path, 2) as made, of_scheduler(made.address, tmp_path / "any") as workers:
        there = side_by_side(math.sqrt, [2.0, 3.0, 5.0], 2, executor=workers.executor)
        with pytest.raises(ValueError):
            side_by_side(math.sqrt, [2.0, -1.0], 2, executor=workers.executor)
    assert there == side_by_side(math.sqrt, [2.0, 3.0, 5.0], 1)


def test_a_scheduler_that_is_gone_is_told_and_nothing_is_lost(tmp_path: Path) -> None:
    write_small_case(tmp_path / "good")
    file = tmp_path / "campaign.toml"
    text = 'cases = ["good"]\nuntil = "mesh"\n[execution]\nscheduler = "tcp://127.0.0.1:1"\n'
    file.write_text(text)
    with pytest.raises(InputError, match="expected the address of a Dask scheduler that answers"):
        batch(file, lambda states, at_a_time: None)
