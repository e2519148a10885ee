"""Who carries out the jobs of a campaign: threads of this machine, or the workers of a cluster."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from driver.batch.calls import Outcome, carry_out, carry_out_on_worker
from driver.batch.jobs import Job
from driver.case.scheduler import KEY, client_of


@dataclass(frozen=True)
class Workers:
    """An executor.

    Attributes:
        executor: hands jobs out.
        at_a_time: how many it carries out side by side.
        where: in words.
        key: of the campaign, which says where.
        work: what they do with a job, its threads and the token.
        refuse_none: raises InputError where none of them can come any more.
        said: where what they have said stands, in words to end a clause, if that is known.
    """

    executor: Executor
    at_a_time: int
    where: str
    key: str = "execution"
    work: Callable[[Job, int, Path], Outcome] = carry_out
    refuse_none: Callable[[], None] = lambda: None
    said: str = ""


@contextmanager
def of_this_machine(at_a_time: int) -> Iterator[Workers]:
    """Hand out jobs to processes of this machine, each with a thread here that waits for it."""
    executor = ThreadPoolExecutor(at_a_time)
    try:
        yield Workers(executor, at_a_time, "on this machine")
    finally:
        executor.shutdown(cancel_futures=True)


@contextmanager
def of_scheduler(address: str, file: Path) -> Iterator[Workers]:
    """Hand out jobs to the workers of a Dask scheduler, one for each of their threads.

    Args:
        address: of the scheduler.
        file: of the campaign, to be told.

    Raises:
        InputError: Dask is not installed, or no scheduler with a worker answers.
    """
    with client_of(address, file) as client:
        at_a_time = sum(client.nthreads().values())
        executor = client.get_executor(pure=False)
        where = f"on the workers of {address}"
        yield Workers(executor, at_a_time, where, KEY, carry_out_on_worker)
