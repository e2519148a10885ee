"""Workers that a queue system starts, each of them a job of it with the cores of one case."""

from __future__ import annotations

import logging
import math
import re
import shlex
import shutil
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import psutil

from driver.batch.calls import carry_out_on_worker
from driver.batch.queues import Queue
from driver.batch.waiting_jobs import why_jobs_wait, without_numbers
from driver.batch.workers import Workers
from driver.common.errors import InputError, one_of, sentence
from driver.results.files import batch_folder, batch_workers

logger = logging.getLogger(__name__)

COMMANDS = {"slurm": ("sbatch", "scancel"), "pbs": ("qsub", "qdel"), "lsf": ("bsub", "bkill")}
"""What hands a job to each queue system, and what takes it back."""
OF_WORKER = 0.5e9
"""Memory of a worker beside that of its case [bytes]."""
_SILENT = 150.0  # s after which a job that has begun and has brought no worker brings none
_PATIENT = 30.0  # s between two looks why jobs wait
_NAME = "prismid"
_WORDS = " (what they said is in {})"
_KEYS = ".dask-jobqueue.*"  # files by which workers and scheduler know each other


def refuse_unusable(queue: Queue, file: Path) -> None:
    """Refuse what keeps this machine from asking a queue system for workers.

    Args:
        queue: what it is asked for.
        file: of the campaign.

    Raises:
        InputError: a library, a command or a network is not there, or the name of a folder does
            not fit into the line of a job; each in a sentence.
    """
    refused = []
    absent = [name for name in ("dask_jobqueue", "cryptography") if find_spec(name) is None]
    if absent:
        found = f"a table without the library {' and '.join(absent)}"
        expected = '`pip install "prismid[cluster]"` before'
        refused.append(sentence(file, "cluster", found, expected))
    for command in COMMANDS[queue.system or ""]:
        if shutil.which(command) is None:
            found = f'"{queue.system}" without its command {command}'
            expected = f"a machine on which {command} can be called"
            refused.append(sentence(file, "cluster.system", found, expected))
    networks = psutil.net_if_addrs()
    if queue.interface is not None and queue.interface not in networks:
        expected = f"a network of this machine, {one_of(queue.interface, sorted(networks))}"
        refused.append(sentence(file, "cluster.interface", f'"{queue.interface}"', expected))
    for what in (str(batch_folder(file)), sys.executable):
        if shlex.quote(what) != what:
            found = f"the path {what}"
            expected = "one of letters, digits and _./-+@%:, as lines of jobs hold it"
            refused.append(sentence(file, "cluster", found, expected))
    if refused:
        raise InputError("\n".join(refused))


@contextmanager
def of_queue(queue: Queue, most: int, cores: int, memory: float, file: Path) -> Iterator[Workers]:
    """Hand out jobs to workers that a queue system starts, as many as there are jobs left.

    Args:
        queue: what it is asked for.
        most: workers at a time.
        cores: of each.
        memory: of the largest case [bytes].
        file: of the campaign.
    """
    import dask
    import distributed

    connect: Any = distributed.Client
    folder, system, made = batch_workers(file), queue.system, cluster_of(queue)
    refused: list[str] = []
    folder.mkdir(exist_ok=True)
    for old in folder.glob(_KEYS):  # of a command that was killed
        old.unlink()
    with (
        # A worker takes no case that it cannot begin.
        dask.config.set({"distributed.scheduler.worker-saturation": 1.0}),
        made(
            job_cls=_counted(made.job_cls, refused),
            silence_logs="critical",  # what matters is told in a sentence
            # Who may speak to a scheduler makes it compute anything.
            security=True,
            shared_temp_directory=str(folder),
            scheduler_options={"dashboard": False, "dashboard_address": ":0"},
            **of_job(queue, cores, memory, folder),
        ) as cluster,
        connect(cluster, set_as_default=False) as client,
    ):
        # A worker for each job: none is done within the time of this target.
        cluster.adapt(maximum_jobs=most, target_duration="1 ms")
        yield Workers(
            client.get_executor(pure=False),
            most,
            f"on workers of {system}",
            "cluster",
            carry_out_on_worker,
            _refuse_none(cluster, refused, folder, file, queue.system or ""),
            _WORDS.format(folder),
        )


def cluster_of(queue: Queue) -> Any:
    """Return the class of dask-jobqueue for a queue system."""
    before = signal.getsignal(signal.SIGINT)
    import dask_jobqueue

    # Its import lets Ctrl-C end the process without a word, and with exit code 0.
    signal.signal(signal.SIGINT, before)
    return getattr(dask_jobqueue, f"{(queue.system or '').upper()}Cluster")


def of_job(queue: Queue, cores: int, memory: float, folder: Path) -> dict[str, Any]:
    """Return what a job is, by the names of dask-jobqueue; the rest is as its own files say.

    Args:
        queue: what the queue system is asked for.
        cores: of the job.
        memory: of the largest case [bytes].
        folder: where its worker writes what it says.
    """
    whole = 1e9 * queue.memory_GB if queue.memory_GB else memory + OF_WORKER
    stated = queue.model_dump(exclude_none=True, exclude={"system", "memory_GB"})
    if queue.system == "lsf":
        if "account" in stated:
            stated["project"] = stated.pop("account")
        minutes = math.ceil(queue.seconds / 60)
        stated["walltime"] = f"{minutes // 60:02d}:{minutes % 60:02d}"
    return {
        "job_name": _NAME,
        "cores": cores,
        "processes": 1,
        "memory": f"{whole:.0f}B",
        "nanny": False,
        "python": sys.executable,
        # The cores are those of the case, which is one task.
        "worker_extra_args": ["--nthreads", "1", "--no-dashboard"],
        "log_directory": str(folder),
        **{key: list(v) if isinstance(v, tuple) else v for key, v in stated.items()},
    }


def _counted(kind: Any, refused: list[str]) -> Any:
    """Return jobs of a kind; where the queue system refuses one, it is kept what was said.

    Such a job counts as one that has begun: Dask would ask for it anew each second.
    """
    from distributed.deploy.spec import ProcessInterface

    begun: Any = ProcessInterface.start
    ended: Any = ProcessInterface.close

    class Counted(kind):  # type: ignore[misc]
        async def start(self) -> None:
            try:
                await super().start()
            except (OSError, RuntimeError, ValueError) as error:
                refused.append(_said(error))
                await begun(self)

        async def close(self) -> None:
            await super().close()
            await ended(self)

    return Counted


def _said(error: Exception) -> str:
    """Return what the command of a queue system has told, in one line."""
    whole = str(error)
    lines = (whole.partition("stderr:\n")[2].strip() or whole).splitlines()
    return "; ".join(line.strip() for line in lines if line.strip())


def _refuse_none(
    cluster: Any, refused: list[str], folder: Path, file: Path, system: str
) -> Callable[[], None]:
    """Return what raises InputError where no worker is there, nor will be.

    Where all jobs wait it is told why, whenever that changes.

    Args:
        cluster: the workers.
        refused: what the queue system has said of those that it did not take.
        folder: where workers write what they say.
        file: of the campaign, to be told.
        system: name of the queue system.
    """
    came: set[str] = set()
    asked, told = time.monotonic(), ""

    def tell_why_they_wait(ids: list[str]) -> None:
        nonlocal asked, told
        if time.monotonic() - asked < _PATIENT:
            return
        why, asked = why_jobs_wait(system, ids), time.monotonic()
        if without_numbers(why) not in ("", without_numbers(told)):
            told = why
            logger.info(f"all jobs of {system} wait: {why}")

    def look() -> None:
        there = {worker.name for worker in list(cluster.scheduler.workers.values())}
        came.update(there)
        jobs = dict(cluster.workers)
        if there or not jobs:
            return
        ids = [job.job_id for name, job in jobs.items() if name not in came and job.job_id]
        if not ids and refused and not came:
            expected = "keys that it takes"
            raise InputError(sentence(file, "cluster", f"“{refused[-1]}”", expected))
        if ids and all(_silent(folder, job) for job in ids):
            raise InputError(
                sentence(
                    file,
                    "cluster",
                    f"jobs {', '.join(ids)} that have begun and brought no worker"
                    + _WORDS.format(folder),
                    "nodes that reach this machine, over cluster.interface if need be, and have "
                    "its files",
                )
            )
        if ids and not any(_logs(folder, job) for job in ids):
            tell_why_they_wait(ids)

    return look


def _logs(folder: Path, job: str) -> list[Path]:
    """Return the logs of a job; there are none before it has begun."""
    of_job = re.compile(rf"(?<!\d){job}(?!\d)")
    keys = set(folder.glob(_KEYS))  # whose names are drawn, digits among them
    return [path for path in folder.iterdir() if of_job.search(path.name) and path not in keys]


def _silent(folder: Path, job: str) -> bool:
    """Whether a job has begun, as its log tells, and has said nothing for long."""
    written = [path.stat().st_mtime for path in _logs(folder, job)]
    return bool(written) and time.time() - max(written) > _SILENT
