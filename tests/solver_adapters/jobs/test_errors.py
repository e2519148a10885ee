from __future__ import annotations

from pathlib import Path

import pytest

from solver_adapters.interface import NotRunError, PreparedError, SolverError
from solver_adapters.jobs.errors import (
    CommandMissingError,
    JobError,
    is_by_circumstances,
    is_out_of_time,
)
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
        JobError("bar", Status.OUT_OF_TIME),
        JobError("bar", Status.BAD_DECK),
        JobError("bar", Status.BROKEN),
        ResultFileError("no field"),
    ],
    ids=str,
)
def test_what_was_not_run_to_its_end_says_nothing_of_the_parameters(error: Exception) -> None:
    assert is_by_circumstances(error)
    assert is_out_of_time(error) == ("out of time" in str(error))


@pytest.mark.parametrize(
    "error",
    [
        SolverError("no step is short enough"),
        ValueError("no such angle"),
        JobError("bar", Status.NOT_CONVERGED),
    ],
    ids=str,
)
def test_what_other_parameters_may_spare_says_something_of_them(error: Exception) -> None:
    assert not is_by_circumstances(error) and not is_out_of_time(error)
