"""What the output of CalculiX says of a run."""

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


def understand(log: str) -> Status:
    """Status of a run from what it has printed; DONE where nothing of a failure is said."""
    for status, pattern in _SIGNS:
        if re.search(pattern, log):
            return status
    return Status.DONE
