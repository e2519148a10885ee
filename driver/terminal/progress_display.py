"""Lines of progress with their time, and below them what is at work."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from time import perf_counter
from typing import TYPE_CHECKING

from rich.console import Console
from rich.markup import escape

from driver.common.formatting import duration, printable
from driver.common.progress import progress_to, seldom
from driver.common.remaining import left_of_run
from driver.terminal.silence import LONGEST_SILENCE, Silence
from driver.terminal.stopping import refuse_to_go_on

if TYPE_CHECKING:
    from driver.batch.progress import State


_PASSING = 0.8 * LONGEST_SILENCE
"""Seconds between lines of one step: they come before silence would be told."""


@contextmanager
def shown_progress(prefix: str = "", err: bool = False) -> Iterator[None]:
    """Show lines of progress; on a terminal with the running step and its time below them.

    Args:
        prefix: what each line begins with after its time.
        err: whether on standard error.
    """
    from solver_adapters.kernels import compiled_before

    console = Console(highlight=False, markup=False, soft_wrap=True, stderr=err)
    start = perf_counter()
    status = console.status("starting") if console.is_terminal else None
    silence = Silence()

    def put(line: str) -> None:
        text = printable(prefix + line)
        console.print(f"{perf_counter() - start:7.1f} s  {text}")
        silence.broken()
        if status is not None:
            status.update(escape(text))

    def show(line: str) -> None:
        refuse_to_go_on()
        put(line)

    if not compiled_before():
        show("first use of this version: its kernels are compiled on the way, a minute or two more")
    if status is None:
        passing = seldom(lambda words: show(f"    {_with_what_is_left(words)}"), _PASSING)
        with silence.told(lambda line: put(_with_what_is_left(line))), progress_to(show, passing):
            yield
    else:

        def update(words: str) -> None:
            status.update(escape(printable(prefix + _with_what_is_left(words))))

        with status, progress_to(show, update):
            yield


def _with_what_is_left(words: str) -> str:
    return "; ".join(filter(None, (words, left_of_run())))


@contextmanager
def shown_states() -> Iterator[Callable[[Sequence[State], int], None]]:
    """Show lines of progress; on a terminal with the states of all jobs as a table below them."""
    from rich.live import Live

    from driver.batch.progress import remaining, table

    console = Console(highlight=False, markup=False, soft_wrap=True)
    start = perf_counter()

    def show(line: str) -> None:
        console.print(f"{perf_counter() - start:7.1f} s  {printable(line)}")

    if console.is_terminal:
        with Live(console=console) as live, progress_to(show):
            yield lambda states, most: live.update(table(states, most))
        return
    tell = seldom(lambda words: show(f"    {words}"))

    def watch(states: Sequence[State], most: int) -> None:
        at_work = [f"{s.job.name} {s.stage}".rstrip() for s in states if s.status == "running"]
        waiting = sum(s.status == "waiting" for s in states)
        left = duration(remaining(states, most))
        tell(f"at work: {', '.join(at_work) or 'none'}; {waiting} waiting; about {left} left")

    with progress_to(show):
        yield watch
