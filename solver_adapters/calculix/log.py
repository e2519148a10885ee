"""What the output of CalculiX says: how a run ended and why, and its version."""

from __future__ import annotations

import re

from solver_adapters.external import Status

# The first that is found counts. CalculiX may end with exit code 0 after an error.
_SIGNS = (
    (Status.OUT_OF_MEMORY, r"error allocating memory|ALLOCATE failure|[Cc]annot allocate memory"),
    (
        Status.NOT_CONVERGED,
        r"\*ERROR: solution seems to diverge|\*ERROR: too many cutbacks|"
        r"\*ERROR: increment size smaller than minimum|\*ERROR: max\. # of increments reached|"
        r"\*ERROR in umat_single_crystal: no convergence|\*ERROR in sc\.f",
    ),
    (Status.BAD_DECK, r"\*ERROR"),
)


# An error with the lines that follow it, up to an empty one.
_CAUSE = re.compile(r"^ *\*ERROR.*(?:\n *\S.*){0,4}", re.MULTILINE)
_VERSION = re.compile(r"This is Version (\S+)")


def cause(log: str) -> str:
    """Return the first error that CalculiX has printed, "" where it printed none."""
    found = _CAUSE.search(log)
    return found[0].strip() if found else ""


def version_in(answer: str) -> str | None:
    """Name and version in the answer to `ccx -v`, as `CalculiX 2.20`."""
    found = _VERSION.search(answer)
    return found and f"CalculiX {found[1]}"


def parse_status(log: str) -> Status:
    """Status of a run from what it has printed; DONE where nothing of a failure is said."""
    for status, pattern in _SIGNS:
        if re.search(pattern, log):
            return status
    return Status.DONE
