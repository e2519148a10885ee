"""What can be wrong with a file that an external solver has left."""

from __future__ import annotations

from solver_adapters.interface import SolverError


class ResultFileError(SolverError):
    """A result file that is missing, truncated, empty or not what it should be."""
