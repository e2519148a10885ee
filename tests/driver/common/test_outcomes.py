from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from driver.common.errors import InputError
from driver.common.outcomes import Failure, attempt
from solver_adapters.interface import NotRunError, PreparedError, SolverError
from solver_adapters.jobs.errors import JobError
from solver_adapters.jobs.status import Status


def end_of(error: Exception) -> str | Failure:
    def work() -> str:
        raise error

    return attempt(work)


def test_work_that_ends_well_is_returned_as_it_is() -> None:
    made = object()
    assert attempt(lambda: made) is made


@pytest.mark.parametrize("kind", [SolverError, InputError])
def test_what_cannot_be_simulated_or_meshed_is_told_by_its_first_line(
    kind: type[Exception],
) -> None:
    assert end_of(kind("no step is short enough\nat t = 1 s")) == Failure("no step is short enough")


def test_a_job_that_failed_by_its_parameters_is_told_without_its_log() -> None:
    told = end_of(JobError("bar", Status.NOT_CONVERGED, "step 3", "the end\nof the log"))
    assert isinstance(told, Failure) and "(step 3)" in told.why and "log says" not in told.why


@pytest.mark.parametrize(
    "error",
    [NotRunError("absent"), PreparedError([Path("jobs/key")]), JobError("bar", Status.KILLED)],
    ids=str,
)
def test_what_was_not_run_to_its_end_is_raised(error: SolverError) -> None:
    with pytest.raises(type(error)):
        end_of(error)


@pytest.mark.parametrize("fault", [np.linalg.LinAlgError("singular"), ValueError("shape")], ids=str)
def test_a_fault_of_the_program_is_no_answer(fault: Exception) -> None:
    with pytest.raises(type(fault)):
        end_of(fault)
