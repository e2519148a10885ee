"""`python -m prismid`, and what the program `prismid` begins with."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

STOPPED = 130
"""Exit code after a signal, as `docs/terminal.md` has it."""
_USUAL: dict[int, Any] = {
    signal.SIGINT: signal.default_int_handler,
    signal.SIGTERM: signal.SIG_DFL,
    signal.SIGHUP: signal.SIG_DFL,
}


def main() -> None:
    """Run the command line."""
    with _stopped_at_once():
        from driver.cli import app
    try:
        app(prog_name="prismid")
    finally:
        # The last word is said: another Ctrl-C would only show where Python is in its end.
        for number in _USUAL:
            signal.signal(number, signal.SIG_IGN)


@contextmanager
def _stopped_at_once() -> Iterator[None]:
    """End the process at a signal: modules that are being loaded leave nothing to tidy up."""

    def leave(*_: object) -> None:
        os.write(sys.stderr.fileno(), b"prismid: stopped before it began\n")
        os._exit(STOPPED)

    taken = [number for number, handler in _USUAL.items() if signal.getsignal(number) == handler]
    for number in taken:
        signal.signal(number, leave)
    yield
    for number in taken:
        signal.signal(number, _USUAL[number])


if __name__ == "__main__":
    # The folder of the call is searched with `-m`: what a user keeps there may have any name.
    own = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
    if not sys.flags.safe_path and os.getcwd() != own and os.getcwd() in sys.path[:2]:
        sys.path.remove(os.getcwd())
    main()
