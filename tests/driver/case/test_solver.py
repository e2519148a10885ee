from __future__ import annotations

from typing import Any, get_args

import pytest

from driver.case.solver import Execution, ProfileTable, Solver
from solver_adapters.interface import Integration
from tests.driver.case.tables import refused


def test_what_a_solver_may_choose_is_not_chosen_for_it() -> None:
    solver = Solver()
    assert (solver.integration, solver.accuracy_uN, solver.gauss_points) == (None, None, None)
    assert set(ProfileTable().model_dump().values()) == {None}


def test_the_finer_simulation_has_finer_steps_from_the_beginning() -> None:
    assert Solver().fine_steps_per_interval > Solver().steps_per_interval


@pytest.mark.parametrize("scheme", get_args(Integration))
def test_every_scheme_of_the_interface_can_be_asked_for(scheme: Integration) -> None:
    assert Solver(integration=scheme).integration == scheme


@pytest.mark.parametrize(
    ("table", "key", "value"),
    [
        (Solver, "integration", "runge_kutta"), (Solver, "steps_per_interval", 0),
        (Solver, "accuracy_uN", 0.0), (Solver, "gauss_points", 6), (Execution, "threads", 0),
        (Execution, "processes", 1.5), (ProfileTable, "command", ()),
        (ProfileTable, "memory_MB", 0.0), (ProfileTable, "wall_time_s", -1.0),
        (Execution, "store", ""), (Execution, "store", "~/jobs"), (Execution, "store", "$HOME"),
    ],
)  # fmt: skip
def test_a_setting_that_no_run_can_have_is_refused(table: Any, key: str, value: Any) -> None:
    assert refused(table, **{key: value})[0] == key
