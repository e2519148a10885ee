"""A Dask scheduler that runs already, whose workers do what a case or a campaign has to do."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import CancelledError
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from driver.case.consent import Request, refuse_unless_agreed
from driver.case.model import Case
from driver.common.errors import InputError, sentence
from solver_adapters.tasks import elsewhere

KEY = "execution.scheduler"
"""The key that names it, of a case or of a campaign."""

_PATIENCE = 10  # s, for the scheduler and its first worker


@contextmanager
def client_of(address: str, file: Path) -> Iterator[Any]:
    """Reach a scheduler with at least one worker, as a client of `distributed`.

    Args:
        address: of the scheduler.
        file: the case or the campaign that names it, to be told.

    Raises:
        InputError: Dask is not installed, or no scheduler with a worker answers.
    """
    try:
        import dask
        import distributed
    except ImportError:
        expected = '`pip install "prismid[cluster]"` before'
        raise InputError(sentence(file, KEY, f'"{address}" without Dask', expected)) from None
    library: Any = distributed  # it has no types
    # Of a scheduler that is lost it tells pages, and of tasks that they hold images.
    quiet = {"distributed.admin.large-graph-warning-threshold": "1 TB"}
    with (
        library.utils.silence_logging_cmgr("critical"),
        dask.config.set(quiet),
        ExitStack() as closing,
    ):
        try:
            client = library.Client(address, timeout=_PATIENCE, set_as_default=False)
        except (OSError, ValueError) as error:
            expected = "the address of a Dask scheduler that answers"
            raise InputError(sentence(file, KEY, f'"{address}" ({error})', expected)) from None
        closing.enter_context(client)
        try:
            client.wait_for_workers(1, timeout=_PATIENCE)
        except TimeoutError:
            found = f'"{address}", which has no worker'
            raise InputError(sentence(file, KEY, found, "one with workers")) from None
        yield client


def requests_of_scheduler(case: Case) -> list[Request]:
    """Return the scheduler of a case, which runs what workers send and is its user's to allow."""
    address = case.execution.scheduler
    return [] if address is None else [Request(KEY, "a scheduler", (address,))]


@contextmanager
def on_workers(case: Case) -> Iterator[None]:
    """Let what runs side by side for a case run on the workers of its scheduler, if it names one.

    Raises:
        ConsentError: the user has not agreed to the scheduler.
        InputError: it does not answer, was lost, or a task has taken its workers down.
    """
    address = case.execution.scheduler
    if address is None:
        yield
        return
    refuse_unless_agreed(case.file, requests_of_scheduler(case))
    with client_of(address, case.file) as client:
        try:
            with elsewhere(client.get_executor(pure=False)):
                yield
        except CancelledError:
            found = f"tasks on the workers of {address} lost"
            expected = "a scheduler that lives; run again to go on"
            raise InputError(sentence(case.file, KEY, found, expected)) from None
        except Exception as error:
            lost = lost_with_workers(error)
            if lost is None:
                raise
            found = f"a task that was {lost}"
            expected = "workers with the memory of a simulation, as `check` estimates it"
            raise InputError(sentence(case.file, KEY, found, expected)) from None


def lost_with_workers(error: Exception, said: str = "") -> str | None:
    """Return what has become of a task that took its workers down, None where it did not.

    Args:
        error: what the scheduler says of the task.
        said: where what its workers have said stands, in words to end a clause.
    """
    failures = getattr(error, "allowed_failures", None)  # as Dask has it
    if failures is None:
        return None
    return (
        f"lost with each worker that was at work on it, {failures + 1} in all, most likely for "
        f"want of memory or of time{said}; run again to go on"
    )
