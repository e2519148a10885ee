"""`prismid batch`: all cases of a campaign, beside one another, and a summary of them."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from contextlib import AbstractContextManager
from pathlib import Path
from time import time
from uuid import uuid4

from driver.batch.calls import Outcome
from driver.batch.campaign import Campaign, read_campaign
from driver.batch.jobs import Job, jobs_of, most_at_a_time, store_of, write_files
from driver.batch.progress import State, at_work, remaining
from driver.batch.queue_workers import of_queue, refuse_unusable
from driver.batch.queues import Queue, queue_of
from driver.batch.requests import requests_of_campaign
from driver.batch.summary import write_summary
from driver.batch.workers import Workers, of_scheduler, of_this_machine
from driver.case.consent import refuse_unless_agreed
from driver.case.scheduler import lost_with_workers
from driver.common import machine
from driver.common.errors import InputError, sentence, why
from driver.common.formatting import cost_told, duration
from driver.results.files import (
    SUMMARY_CSV,
    SUMMARY_HTML,
    batch_folder,
    batch_token,
    make_folder,
    make_job_store,
    refuse_links_of_batch,
)
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
    path = Path(os.path.abspath(path))
    campaign = read_campaign(path)
    refuse_unless_agreed(path, requests_of_campaign(campaign))
    jobs, queue = _planned(campaign, path)
    folder = batch_folder(path)
    make_folder(folder, path)
    refuse_links_of_batch(path)
    if campaign.execution.store is not None:
        make_job_store(store_of(campaign.execution.store, path), path)
    with sole_run(folder):
        write_files(jobs)
        states = [State(job, "waiting") for job in jobs]
        try:
            with _workers(campaign, queue, path, jobs) as workers:
                _foretell(jobs, campaign, queue, workers)
                _carry_out(states, campaign, workers, path, watch)
        finally:
            # Of a campaign that is stopped, too: what is done, and what is not.
            make_folder(folder, path)
            write_summary(folder, path.stem, states)
    logger.info(f"{folder / SUMMARY_HTML} and {SUMMARY_CSV} compare the cases")
    return all(state.status == "done" for state in states)


def _planned(campaign: Campaign, file: Path) -> tuple[list[Job], Queue | None]:
    """Return the jobs of a campaign, and the queue system that it asks for.

    Raises:
        InputError: all that is wrong with them, each in a sentence.
    """
    jobs: list[Job] = []
    queue: Queue | None = None
    refused: list[str] = []
    try:
        jobs = jobs_of(campaign, file)
    except InputError as error:
        refused.append(str(error))
    if campaign.cluster is not None:
        try:
            queue = queue_of(campaign.cluster, file)
            refuse_unusable(queue, file)
        except InputError as error:
            refused.append(str(error))
    if refused:
        raise InputError("\n".join(refused))
    return jobs, queue


def _workers(
    campaign: Campaign, queue: Queue | None, file: Path, jobs: Sequence[Job]
) -> AbstractContextManager[Workers]:
    use = campaign.execution
    if use.scheduler is not None:
        return of_scheduler(use.scheduler, file)
    if queue is not None:
        left = sum(job.cost.seconds > 0 for job in jobs)
        most = max(1, min(left, use.jobs or left))
        memory = max(job.cost.memory for job in jobs)
        return of_queue(queue, most, max(job.cores for job in jobs), memory, file)
    return of_this_machine(most_at_a_time(jobs, campaign, machine.cores(), machine.memory()))


def _foretell(
    jobs: Sequence[Job], campaign: Campaign, queue: Queue | None, workers: Workers
) -> None:
    """Tell what the campaign takes, and where that is more than there is."""
    use, at_a_time = campaign.execution, workers.at_a_time
    waiting = [State(job, "waiting") for job in jobs]
    largest = max(job.cost.memory for job in jobs)
    cores = at_a_time * max(job.cores for job in jobs)
    cases = "1 case" if len(jobs) == 1 else f"{len(jobs)} cases"
    cost = cost_told(remaining(waiting, at_a_time), at_a_time * largest)
    told = f"{cases}, {at_a_time} at a time on {cores} core(s) {workers.where}"
    logger.info(f"{told}: {cost} in all")
    longest = max(job.cost.seconds for job in jobs)
    if queue is not None and longest > queue.seconds:
        logger.info(
            f"the longest case takes {duration(longest)}, the walltime is "
            f"{duration(queue.seconds)}: it goes on in another job after its last finished stage"
        )
    if workers.key != "execution":
        return
    stated = machine.memory() if use.memory_GB is None else 1e9 * use.memory_GB
    if largest > stated:
        logger.info(f"one case alone needs {largest / 1e9:.1f} GB, there are {stated / 1e9:.3g}")
    if cores > machine.cores():
        logger.info(f"{cores} cores are asked for, there are {machine.cores()}")


def _carry_out(
    states: list[State], campaign: Campaign, workers: Workers, file: Path, watch: Watch
) -> None:
    """Carry out all jobs and keep their states; where this ends early they are stopped."""
    jobs = [state.job for state in states]
    threads, start = campaign.execution.threads, time()
    for old in batch_folder(file).glob(batch_token(file, "*").name):
        old.unlink(missing_ok=True)
    token = batch_token(file, uuid4().hex[:8])
    token.touch()
    try:
        futures = {
            workers.executor.submit(workers.work, job, threads, token): index
            for index, job in enumerate(jobs)
        }
        left = set(futures)
        while left:
            ended, left = wait(left, _EVERY, FIRST_COMPLETED)
            for future in ended:
                index = futures[future]
                states[index] = _ended(jobs[index], future, workers, file)
            for index in (futures[future] for future in left):
                states[index] = at_work(jobs[index], start)
            watch(states, workers.at_a_time)
            if left:
                workers.refuse_none()
            if not token.exists():
                found, expected = (
                    "nothing any more: all cases are stopped",
                    "it; run again to go on",
                )
                raise InputError(sentence(token.parent, "folder", found, expected))
            token.touch()
    finally:
        token.unlink(missing_ok=True)


def _ended(job: Job, future: Future[Outcome], workers: Workers, file: Path) -> State:
    """Return the state of a job that has ended, and tell it.

    Raises:
        InputError: the scheduler is gone.
    """
    try:
        outcome = future.result()
    except CancelledError:
        found, expected = f"jobs {workers.where} lost", "a scheduler that lives; run again to go on"
        raise InputError(sentence(file, workers.key, found, expected)) from None
    except OSError as error:
        place = Path(error.filename or job.log)
        outcome = Outcome("failed", sentence(place, "file", why(error), "one to be written"), 0.0)
    except Exception as error:
        # Whatever a cluster says of a worker that it cannot use.
        lost = lost_with_workers(error, workers.said)
        told = lost or f"{type(error).__name__}: {error}"
        outcome = Outcome("failed", told, 0.0)
    state = State(job, outcome.status, outcome.seconds, words=outcome.why)
    reason = f": {outcome.why}" if outcome.why else ""
    logger.info(f"{job.name}: {outcome.status} after {duration(outcome.seconds)}{reason}")
    return state
