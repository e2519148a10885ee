from __future__ import annotations

from pathlib import Path

import pytest

from solver_adapters.interface import NotRunError, PreparedError, SolverError
from solver_adapters.jobs.errors import CommandMissingError, JobError, ends_all
from solver_adapters.jobs.status import Status
from solver_adapters.result_files import ResultFileError


@pytest.mark.parametrize(
    "error",
    [
        NotRunError("absent"),
        PreparedError([Path("jobs/key")]),
        CommandMissingError("bar", Status.COMMAND_MISSING),
        JobError("bar", Status.KILLED),
        JobError("bar", Status.OUT_OF_MEMORY),
        ResultFileError("no field"),
    ],
    ids=str,
)
def test_what_says_nothing_of_the_parameters_ends_all(error: Exception) -> None:
    assert ends_all(error)


@pytest.mark.parametrize(
    "error",
    [
        SolverError("no step is short enough"),
        ValueError("no such angle"),
        JobError("bar", Status.NOT_CONVERGED),
        JobError("bar", Status.OUT_OF_TIME),
    ],
    ids=str,
)
def test_what_other_parameters_may_spare_does_not(error: Exception) -> None:
    assert not ends_all(error)
