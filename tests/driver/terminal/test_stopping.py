"""Tests of a stop that comes where it must not be raised."""

from __future__ import annotations

import signal
from collections import deque
from collections.abc import Callable
from concurrent.futures import _base
from functools import partial
from operator import call
from threading import Condition, Lock
from time import sleep
from types import SimpleNamespace
from typing import Any

import pytest
import typer

from driver.terminal.exit_codes import STOPPED
from driver.terminal.stopping import stoppable

_STOP = partial(signal.raise_signal, signal.SIGINT)


def _in_turn(*calls: Callable[[], object]) -> Callable[[], object]:
    """Calls as one, without code of Python: a signal is heard by the code that calls it."""
    return partial(deque, map(call, calls))


def _condition_entered(lock: Any) -> Any:
    return Condition(
        SimpleNamespace(
            acquire=lock.acquire, release=lock.release,
            __enter__=_in_turn(lock.acquire, _STOP), __exit__=lock.__exit__,
        )  # type: ignore[arg-type]
    )  # fmt: skip


def _futures_taken(lock: Any) -> Any:
    condition = SimpleNamespace(acquire=_in_turn(lock.acquire, _STOP), release=lock.release)
    future: Any = SimpleNamespace(_condition=condition)
    return _base._AcquireFutures([future])


def _futures_given_back(lock: Any) -> Any:
    condition = SimpleNamespace(acquire=lock.acquire, release=_in_turn(_STOP, lock.release))
    future: Any = SimpleNamespace(_condition=condition)
    return _base._AcquireFutures([future])


@pytest.mark.parametrize("made", [_condition_entered, _futures_taken, _futures_given_back])
def test_a_stop_leaves_no_lock_taken_and_ends_what_goes_on(made: Callable[[Any], Any]) -> None:
    """A thread that wanted the lock of a future kept a campaign from ending."""
    lock = Lock()
    went_on = False
    with pytest.raises(typer.Exit) as ended, stoppable():
        with made(lock):
            assert lock.locked()
        sleep(5.0)
        went_on = True
    assert ended.value.exit_code == STOPPED
    assert not lock.locked() and not went_on


def test_a_stop_that_waits_for_a_lock_comes_where_other_signals_are_ignored() -> None:
    """As below a shell that traps SIGTERM, say."""
    before = signal.signal(signal.SIGTERM, signal.SIG_IGN)
    went_on = False
    try:
        with pytest.raises(typer.Exit), stoppable():
            with _condition_entered(Lock()):
                pass
            sleep(5.0)
            went_on = True
    finally:
        signal.signal(signal.SIGTERM, before)
    assert not went_on
