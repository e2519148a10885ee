"""`prismid batch`: all cases of a campaign, beside one another, and a summary of them."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from contextlib import AbstractContextManager
from pathlib import Path
from time import time

from driver.batch.calls import Outcome, carry_out
from driver.batch.campaign import Campaign, read_campaign
from driver.batch.jobs import Job, jobs_of, most_at_a_time
from driver.batch.progress import State, at_work, remaining
from driver.batch.summary import write_summary
from driver.batch.workers import Workers, of_cluster, of_this_machine
from driver.common.errors import InputError, sentence
from driver.common.formatting import cost_told, duration
from driver.results.files import SUMMARY_CSV, SUMMARY_HTML, batch_folder, batch_token, make_folder
from driver.workflow.run_lock import sole_run

logger = logging.getLogger(__name__)

Watch = Callable[[Sequence[State], int], None]
"""Is shown the states of all jobs, and how many run at a time."""
_EVERY = 1.0  # s between two looks at the logs


def batch(path: Path, watch: Watch) -> bool:
    """Run all cases of a campaign; what is done and unchanged is not done again.

    A case that fails is told and keeps no other from running.

    Args:
        path: the file of the campaign.
        watch: is shown how far all jobs are, about once a second.

    Returns:
        Whether all of them are done.

    Raises:
        InputError: the campaign, or a case of it, cannot be used; another run is at work on it; or
            the scheduler is gone.
    """
    # Workers have folders of their own.
    path = path.absolute()
    campaign = read_campaign(path)
    folder = batch_folder(path)
    make_folder(folder)
    with sole_run(folder):
        jobs = jobs_of(campaign, path)
        with _workers(campaign, path, jobs) as workers:
            _foretell(jobs, campaign, workers)
            states = _carried_out(jobs, campaign, workers, path, watch)
        write_summary(folder, path.stem, states)
    logger.info(f"{folder / SUMMARY_HTML} and {SUMMARY_CSV} compare the cases")
    return all(state.status == "done" for state in states)


def _workers(
    campaign: Campaign, file: Path, jobs: Sequence[Job]
) -> AbstractContextManager[Workers]:
    if campaign.execution.scheduler is not None:
        return of_cluster(campaign.execution.scheduler, file)
    cores, memory = os.cpu_count() or 1, _memory_of_machine()
    return of_this_machine(most_at_a_time(jobs, campaign, cores, memory))


def _foretell(jobs: Sequence[Job], campaign: Campaign, workers: Workers) -> None:
    waiting = [State(job, "waiting") for job in jobs]
    memory = workers.at_a_time * max(job.cost.memory for job in jobs)
    use = campaign.execution
    cores = workers.at_a_time * use.processes * use.threads
    cost = cost_told(remaining(waiting, workers.at_a_time), memory)
    logger.info(
        f"{len(jobs)} cases, {workers.at_a_time} at a time on {cores} core(s) {workers.where}: "
        f"{cost} in all"
    )


def _carried_out(
    jobs: Sequence[Job], campaign: Campaign, workers: Workers, file: Path, watch: Watch
) -> list[State]:
    """Return how all jobs ended; those of a campaign that is stopped have been stopped, too."""
    states = [State(job, "waiting") for job in jobs]
    token, threads = batch_token(file), campaign.execution.threads
    token.touch()
    start = time()
    try:
        futures = {
            workers.executor.submit(carry_out, job, threads, token): index
            for index, job in enumerate(jobs)
        }
        left = set(futures)
        while left:
            ended, left = wait(left, _EVERY, FIRST_COMPLETED)
            for future in ended:
                index = futures[future]
                states[index] = _ended(jobs[index], future, workers.where, file)
            for index in (futures[future] for future in left):
                states[index] = at_work(jobs[index], start)
            watch(states, workers.at_a_time)
    finally:
        token.unlink(missing_ok=True)
    return states


def _ended(job: Job, future: Future[Outcome], where: str, file: Path) -> State:
    """Return the state of a job that has ended, and tell it.

    Raises:
        InputError: the scheduler is gone.
    """
    try:
        outcome = future.result()
    except CancelledError:
        found, expected = f"jobs {where} lost", "a scheduler that lives; run again to go on"
        raise InputError(sentence(file, "execution.scheduler", found, expected)) from None
    except Exception as error:
        # Whatever a cluster says of a worker that it has lost, or cannot use.
        outcome = Outcome("failed", f"{type(error).__name__}: {error}", 0.0)
    state = State(job, outcome.status, outcome.seconds, words=outcome.why)
    why = f": {outcome.why}" if outcome.why else ""
    logger.info(f"{job.name}: {outcome.status} after {duration(outcome.seconds)}{why}")
    return state


def _memory_of_machine() -> float:
    """Memory of this machine [bytes]."""
    return float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
