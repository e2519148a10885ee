"""A Dask scheduler and its workers as processes that speak over TCP."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import psutil

from solver_adapters.kernels import PACKAGES

ADDRESS = re.compile(r"Scheduler at:\s+(tcp://\S+)")


@contextmanager
def process(
    *arguments: str, log: Path, settings: Mapping[str, str]
) -> Iterator[subprocess.Popen[bytes]]:
    with log.open("wb") as file:
        made = subprocess.Popen(
            [sys.executable, "-m", "distributed.cli." + arguments[0], *arguments[1:]],
            env={**os.environ, "PYTHONPATH": str(PACKAGES), **settings},
            stdout=file,
            stderr=file,
        )
        try:
            yield made
        finally:
            made.kill()
            made.wait()


@dataclass(frozen=True)
class Cluster:
    """A scheduler, its address, and its workers of one thread each."""

    address: str
    scheduler: subprocess.Popen[bytes]
    workers: Sequence[subprocess.Popen[bytes]]

    @property
    def processes(self) -> list[psutil.Process]:
        """The workers, to be looked at."""
        return [psutil.Process(worker.pid) for worker in self.workers]


@contextmanager
def cluster(
    folder: Path, workers: int, port: int = 0, settings: Mapping[str, str] | None = None
) -> Iterator[Cluster]:
    with ExitStack() as stack:
        log, variables = folder / "scheduler.log", settings or {}
        start = ("dask_scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard")
        scheduler = stack.enter_context(process(*start, log=log, settings=variables))
        while not (found := ADDRESS.search(log.read_text("utf-8"))):
            assert scheduler.poll() is None, log.read_text("utf-8")
            time.sleep(0.1)
        own = (
            "dask_worker", found[1], "--nthreads", "1", "--no-dashboard", "--no-nanny",
            "--local-directory", str(folder / "dask"),
        )  # fmt: skip
        each = [
            stack.enter_context(process(*own, log=folder / f"worker_{k}.log", settings=variables))
            for k in range(workers)
        ]
        for k, worker in enumerate(each):
            while "Registered to" not in (folder / f"worker_{k}.log").read_text("utf-8"):
                assert worker.poll() is None
                time.sleep(0.1)
        yield Cluster(found[1], scheduler, each)
