"""`prismid batch`: all cases of a campaign, beside one another, and a summary of them."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from pathlib import Path
from time import monotonic

from driver.batch.calls import Outcome, carry_out
from driver.batch.campaign import Campaign, read_campaign
from driver.batch.jobs import Job, jobs_of, most_at_a_time
from driver.batch.progress import State, remaining, running
from driver.batch.summary import write_summary
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
        InputError: the campaign, or a case of it, cannot be used; or another run is at work on it.
    """
    campaign = read_campaign(path)
    folder = batch_folder(path)
    make_folder(folder)
    with sole_run(folder):
        jobs = jobs_of(campaign, path)
        cores, memory = os.cpu_count() or 1, _memory_of_machine()
        at_a_time = most_at_a_time(jobs, campaign, cores, memory)
        _foretell(jobs, campaign, at_a_time)
        states = _carried_out(jobs, campaign, at_a_time, batch_token(path), watch)
        write_summary(folder, path.stem, states)
    logger.info(f"{folder / SUMMARY_HTML} and {SUMMARY_CSV} compare the cases")
    return all(state.status == "done" for state in states)


def _foretell(jobs: Sequence[Job], campaign: Campaign, at_a_time: int) -> None:
    waiting = [State(job, "waiting") for job in jobs]
    memory = at_a_time * max(job.cost.memory for job in jobs)
    use = campaign.execution
    cores = at_a_time * use.processes * use.threads
    cost = cost_told(remaining(waiting, at_a_time), memory)
    logger.info(f"{len(jobs)} cases, {at_a_time} at a time on {cores} core(s): {cost} in all")


def _carried_out(
    jobs: Sequence[Job], campaign: Campaign, at_a_time: int, token: Path, watch: Watch
) -> list[State]:
    """Return how all jobs ended; those of a campaign that is stopped have been stopped, too."""
    states = [State(job, "waiting") for job in jobs]
    began: dict[int, float] = {}
    token.touch()

    def work(index: int) -> Outcome:
        began[index] = monotonic()
        return carry_out(jobs[index], campaign.execution.threads, token)

    with ThreadPoolExecutor(at_a_time) as pool:
        futures = {pool.submit(work, index): index for index in range(len(jobs))}
        try:
            left = set(futures)
            while left:
                ended, left = wait(left, _EVERY, FIRST_COMPLETED)
                for future in ended:
                    index = futures[future]
                    states[index] = _ended(jobs[index], future)
                for index, start in list(began.items()):
                    if states[index].status in ("waiting", "running"):
                        states[index] = running(jobs[index], monotonic() - start)
                watch(states, at_a_time)
        finally:
            token.unlink(missing_ok=True)
            pool.shutdown(cancel_futures=True)
    return states


def _ended(job: Job, future: Future[Outcome]) -> State:
    """Return the state of a job that has ended, and tell it."""
    outcome = future.result()
    state = State(job, outcome.status, outcome.seconds, words=outcome.why)
    why = f": {outcome.why}" if outcome.why else ""
    logger.info(f"{job.name}: {outcome.status} after {duration(outcome.seconds)}{why}")
    return state


def _memory_of_machine() -> float:
    """Memory of this machine [bytes]."""
    return float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
