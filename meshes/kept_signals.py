"""Signals that stay as set where a library of C sets them for itself."""

from __future__ import annotations

import ctypes
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from signal import Signals

_ACTION = 1024  # bytes, more than `struct sigaction` has on any system


@contextmanager
def signals_kept(signals: Collection[Signals]) -> Iterator[None]:
    """Set signals back after the block, in whatever thread, with all that was set for them.

    A library that takes them back by `signal` of C leaves them with SA_RESTART: a lock that is
    waited for keeps Python from hearing of one.
    """
    library = ctypes.CDLL(None)
    before = {each: ctypes.create_string_buffer(_ACTION) for each in signals}
    for each, action in before.items():
        library.sigaction(int(each), None, action)
    try:
        yield
    finally:
        for each, action in before.items():
            library.sigaction(int(each), action, None)
