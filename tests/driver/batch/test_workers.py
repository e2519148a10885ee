"""A Dask scheduler and its workers, as processes that talk over TCP."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

import psutil
import pytest

from driver.batch.command import batch
from driver.batch.progress import State
from driver.common.errors import InputError
from solver_adapters.kernels import PACKAGES
from tests.driver.batch.cases import rows, write_small_case

ADDRESS = re.compile(r"Scheduler at:\s+(tcp://\S+)")


@contextmanager
def process(*arguments: str, log: Path) -> Iterator[subprocess.Popen[bytes]]:
    with log.open("wb") as file:
        made = subprocess.Popen(
            [sys.executable, "-m", "distributed.cli." + arguments[0], *arguments[1:]],
            env=os.environ | {"PYTHONPATH": str(PACKAGES)},
            stdout=file,
            stderr=file,
        )
        try:
            yield made
        finally:
            made.kill()
            made.wait()


@contextmanager
def cluster(folder: Path, workers: int) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """Address of a scheduler, and its workers of one thread each."""
    with ExitStack() as stack:
        log = folder / "scheduler.log"
        start = ("dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard")
        scheduler = stack.enter_context(process(*start, log=log))
        while not (found := ADDRESS.search(log.read_text("utf-8"))):
            assert scheduler.poll() is None, log.read_text("utf-8")
            time.sleep(0.1)
        own = (
            "dask_worker", found[1], "--nthreads", "1", "--no-dashboard", "--no-nanny",
            "--local-directory", str(folder / "dask"),
        )  # fmt: skip
        each = [
            stack.enter_context(process(*own, log=folder / f"worker_{k}.log"))
            for k in range(workers)
        ]
        yield found[1], each


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
    with cluster(tmp_path, 2) as (address, workers):
        file.write_text(
            'until = "mesh"\n[[trial]]\ncase = "good/case.toml"\nsettings = "s.toml"\n'
            f'seeds = [1, 2, 3]\n[execution]\nscheduler = "{address}"\n'
        )

        def watch(states: Sequence[State], at_a_time: int) -> None:
            busy = [s for s in states if s.status == "running" and "truth" in s.words]
            if busy and not killed:
                victim = next(w for w in workers if psutil.Process(w.pid).children())
                killed.append(victim.pid)
                victim.kill()

        assert batch(file, watch)
        assert killed and sum(w.poll() is None for w in workers) == 1
    assert f"3 cases, 2 at a time on 2 core(s) on the workers of {address}" in lines[0]
    assert {row["status"] for row in rows(file).values()} == {"done"} and len(rows(file)) == 3


def test_a_scheduler_that_is_gone_is_told_and_nothing_is_lost(tmp_path: Path) -> None:
    write_small_case(tmp_path / "good")
    file = tmp_path / "campaign.toml"
    text = 'cases = ["good"]\nuntil = "mesh"\n[execution]\nscheduler = "tcp://127.0.0.1:1"\n'
    file.write_text(text)
    with pytest.raises(InputError, match="expected the address of a Dask scheduler that answers"):
        batch(file, lambda states, at_a_time: None)
