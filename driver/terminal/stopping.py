"""How a signal stops the program, wherever it is: Ctrl-C, the limit of a batch system, a hang-up.

Python raises an error for a signal in whatever code is at work. Where that code is called back by C
or by the garbage collector, Python tells of the error and goes on, and a library may catch it: a
stop that was asked for is therefore remembered, and raised again until it has ended the program.
Where a condition is about to be entered or left the error would leave its lock taken for ever, and
whatever thread wants it next would wait for ever: it is raised soon after.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import _base
from contextlib import contextmanager
from dataclasses import dataclass
from time import sleep
from types import FrameType
from typing import Any

import typer

from driver.terminal.exit_codes import STOPPED
from driver.terminal.output import tell_error

_SIGNALS = {
    signal.SIGINT: signal.default_int_handler,
    signal.SIGTERM: signal.SIG_DFL,
    signal.SIGHUP: signal.SIG_DFL,
}
"""Signals that stop the program, with their usual handlers: nohup, say, has others."""
_LOCKING = frozenset(
    getattr(kind, name).__code__
    for kind in (threading.Condition, _base._AcquireFutures)
    for name in ("__enter__", "__exit__")
)
"""Code that takes locks and gives them back: an error raised there leaves them taken."""
_SOON = 0.05  # s after which a stop that came to nothing is raised again
_AGAIN = 10.0  # s after which a process that was asked to end is asked once more
_TOLD = "stopped; finished stages are kept, run again to go on"


@dataclass
class _Asked:
    """Whether a stop was asked for, and by which signal last."""

    asked: bool = False
    number: int = signal.SIGTERM


_STOP = _Asked()


def refuse_to_go_on() -> None:
    """End what goes on although a stop was asked for.

    Raises:
        KeyboardInterrupt: it was.
    """
    if _STOP.asked:
        raise KeyboardInterrupt


@contextmanager
def stoppable() -> Iterator[None]:
    """End what is inside by a sentence and the exit code of a stop, once a signal asks for it.

    Raises:
        typer.Exit: a signal has asked for it, whatever has become of it inside.
    """
    try:
        with _heard(_STOP):
            yield
            refuse_to_go_on()
    except BaseException as error:
        if not (_STOP.asked or isinstance(error, KeyboardInterrupt)):
            raise
        tell_error(_TOLD)
        raise typer.Exit(STOPPED) from None
    finally:
        _STOP.asked = False


@contextmanager
def _heard(stop: _Asked) -> Iterator[None]:
    """Raise KeyboardInterrupt inside for each signal, and again where that came to nothing."""

    def raise_it(number: int, frame: FrameType | None) -> None:
        stop.asked, stop.number = True, number
        if frame is not None and frame.f_code in _LOCKING:
            _raise_soon()
        else:
            raise KeyboardInterrupt

    def ignored(lost: Any) -> None:
        if issubclass(lost.exc_type, KeyboardInterrupt):
            _raise_soon()  # not from here: it would be lost, too
        else:
            usual(lost)

    usual: Callable[[Any], object] = sys.unraisablehook
    before = {
        number: signal.signal(number, raise_it)
        for number, handler in _SIGNALS.items()
        if signal.getsignal(number) == handler
    }
    sys.unraisablehook = ignored
    try:
        yield
    finally:
        sys.unraisablehook = usual
        for number, handler in before.items():
            signal.signal(number, handler)


def _raise_soon() -> None:
    threading.Thread(target=_raise_again, daemon=True).start()


def _raise_again() -> None:
    sleep(_SOON)
    if _STOP.asked:
        # By the same signal: whoever started the program may have it ignore the others.
        signal.pthread_kill(threading.main_thread().ident or 0, _STOP.number)


def stop_at_end_of_input() -> None:
    """Stop this process where its input ends: who started it holds the other end."""
    threading.Thread(target=_stop_at_end_of_input, daemon=True).start()


def _stop_at_end_of_input() -> None:
    # Not by `sys.stdin`, whose lock would be held where Python ends.
    while os.read(sys.stdin.fileno(), 1):
        pass
    while True:
        os.kill(os.getpid(), signal.SIGTERM)
        sleep(_AGAIN)
