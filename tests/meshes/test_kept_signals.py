"""A signal is after the block what it was before, for Python and for the system."""

from __future__ import annotations

import ctypes
import os
import signal
import threading
from collections.abc import Iterator

import pytest

from meshes.kept_signals import signals_kept

LIBRARY = ctypes.CDLL(None)
LIBRARY.signal.argtypes = (ctypes.c_int, ctypes.c_void_p)
IGNORED = int(signal.SIG_IGN)


class Heard(Exception):
    """The signal was heard."""


@pytest.fixture(autouse=True)
def told() -> Iterator[None]:
    def raised(number: int, frame: object) -> None:
        raise Heard

    before = signal.signal(signal.SIGUSR1, raised)
    yield
    signal.signal(signal.SIGUSR1, before)


def test_what_a_library_sets_holds_inside_alone() -> None:
    with signals_kept((signal.SIGUSR1,)):
        LIBRARY.signal(signal.SIGUSR1, IGNORED)
        os.kill(os.getpid(), signal.SIGUSR1)
    with pytest.raises(Heard):
        os.kill(os.getpid(), signal.SIGUSR1)


def test_they_are_set_back_where_the_block_raises() -> None:
    with pytest.raises(RuntimeError), signals_kept((signal.SIGUSR1,)):
        LIBRARY.signal(signal.SIGUSR1, IGNORED)
        raise RuntimeError
    with pytest.raises(Heard):
        os.kill(os.getpid(), signal.SIGUSR1)


def test_others_stay_as_the_block_leaves_them() -> None:
    with signals_kept((signal.SIGUSR2,)):
        LIBRARY.signal(signal.SIGUSR1, IGNORED)
    assert LIBRARY.signal(signal.SIGUSR1, IGNORED) == IGNORED


def test_what_is_blocked_inside_is_not_blocked_any_more() -> None:
    with signals_kept((signal.SIGUSR1,)):
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGUSR1})
    with pytest.raises(Heard):
        os.kill(os.getpid(), signal.SIGUSR1)


def test_a_thread_waits_for_the_block_of_another_and_sets_back_what_was_before_both() -> None:
    begun, go_on, done = threading.Event(), threading.Event(), threading.Event()

    def first() -> None:
        with signals_kept((signal.SIGUSR1,)):
            LIBRARY.signal(signal.SIGUSR1, IGNORED)
            begun.set()
            go_on.wait(60.0)

    def second() -> None:
        with signals_kept((signal.SIGUSR1,)):
            done.set()

    threads = [threading.Thread(target=first), threading.Thread(target=second)]
    threads[0].start()
    begun.wait(60.0)
    threads[1].start()
    assert not done.wait(0.2)
    go_on.set()
    for thread in threads:
        thread.join(60.0)
    with pytest.raises(Heard):
        os.kill(os.getpid(), signal.SIGUSR1)


def test_a_signal_that_cannot_be_set_is_told() -> None:
    with pytest.raises(OSError, match="sigaction of SIGKILL"), signals_kept((signal.SIGKILL,)):
        pass
