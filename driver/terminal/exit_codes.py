"""Exit codes of the program, as `docs/terminal.md` has them."""

from __future__ import annotations

DONE = 0
"""What was asked for is done."""
FAILED = 1
"""Something was refused, or could not be done; a check found an error."""
USAGE = 2
"""No such verb, option or value of one."""
FAULT = 3
"""A fault of prismid itself, whose traceback stands in a file."""
STOPPED = 130
"""Ctrl-C, SIGTERM or SIGHUP."""
