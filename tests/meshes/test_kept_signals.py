"""A signal is after the block what it was before, for Python and for the system."""

from __future__ import annotations

import ctypes
import os
import signal
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
    os.kill(os.getpid(), signal.SIGUSR1)
