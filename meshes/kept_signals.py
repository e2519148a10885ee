"""Signals that stay as set where a library of C sets them for itself."""

from __future__ import annotations

import ctypes
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from os import strerror
from signal import SIG_BLOCK, SIG_SETMASK, Signals, pthread_sigmask
from threading import RLock

_ACTION = 1024  # bytes, more than `struct sigaction` has on any system
# Of two threads each would set back what the other has set.
_ONE_AT_A_TIME = RLock()


@contextmanager
def signals_kept(signals: Collection[Signals]) -> Iterator[None]:
    """Set signals back after the block, in whatever thread, with all that was set for them.

    A library that takes them back by `signal` of C leaves them with SA_RESTART: a lock that is
    waited for keeps Python from hearing of one. One that leaps out of its handler leaves the signal
    blocked.
    """
    before = {each: ctypes.create_string_buffer(_ACTION) for each in signals}
    with _ONE_AT_A_TIME:
        blocked = pthread_sigmask(SIG_BLOCK, ())
        for each, action in before.items():
            _act(each, None, action)
        try:
            yield
        finally:
            for each, action in before.items():
                _act(each, action, None)
            pthread_sigmask(SIG_SETMASK, blocked)


def _act(
    number: Signals,
    new: ctypes.Array[ctypes.c_char] | None,
    old: ctypes.Array[ctypes.c_char] | None,
) -> None:
    library = ctypes.CDLL(None, use_errno=True)
    if library.sigaction(int(number), new, old) != 0:
        code = ctypes.get_errno()
        raise OSError(code, f"sigaction of {number.name}: {strerror(code)}")
