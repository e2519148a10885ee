from __future__ import annotations

import numpy as np
import pytest

from driver.identification.fit import Fit, fit
from driver.identification.multistart import FARTHEST, draw_starts, from_each_start
from driver.parameters.registry import declared_parameters
from solver_adapters.interface import NotRunError, PreparedError, SolverError
from solver_adapters.parameter import Parameter
from tests.driver.analytic import formula

START = {"tau0": 40.0, "c": 40e3, "lambda_plus_Y": 1.0, "d": 1500.0, "elongation_1": 0.06}
PARAMETERS = declared_parameters(2)
SPREAD = {"tau0": 1.0, "lambda_plus_Y": 2.0}


def test_starts_scatter_about_that_of_the_case_and_are_the_same_each_time() -> None:
    starts = draw_starts(START, PARAMETERS, SPREAD, 400)
    assert starts[0] == START and starts == draw_starts(START, PARAMETERS, SPREAD, 400)
    assert starts[:3] == draw_starts(START, PARAMETERS, SPREAD, 3)
    tau0 = np.log([start["tau0"] / 40.0 for start in starts])
    lam = np.array([start["lambda_plus_Y"] - 1.0 for start in starts])
    assert np.std(tau0) == pytest.approx(0.95, abs=0.1) and np.abs(tau0).max() <= FARTHEST + 1e-9
    assert np.std(lam) == pytest.approx(0.19, abs=0.02)
    assert all(start["d"] == 1500.0 and start["elongation_1"] == 0.06 for start in starts)


def two_valleys(start: dict[str, float]) -> Fit:
    """The cost (a² − 1)² + (a + 1)²/4: its deeper valley is at −1."""
    if start["a"] > 5.0:
        raise SolverError("the step could not be solved\nand more")
    if start["a"] < -5.0:
        raise PreparedError([])
    objective = formula(
        lambda p: (np.array([p[0] ** 2, p[0] / 2]), np.array([[2 * p[0], 0.5]])),
        np.array([1.0, -0.5]),
        [Parameter("a", "", 0.0, 1.0)],
    )
    return fit(objective, start, ("a",), 30, tolerance=1e-9)


def of_fit(found: Fit) -> Fit:
    return found


@pytest.mark.parametrize("processes", [1, 2])
def test_the_best_start_is_kept_and_all_are_told(
    processes: int,
    lines: list[str],
) -> None:
    tasks = [{"a": 2.0}, {"a": -2.0}, {"a": 9.0}, {"a": -3.0}]
    best, outcomes = from_each_start(two_valleys, tasks, of_fit, ("a",), processes, 1)
    assert best.values["a"] == pytest.approx(-1.0, abs=1e-3)
    assert [o.values.get("a", 0.0) for o in outcomes] == pytest.approx(
        [0.87, -1.0, 0.0, -1.0], abs=0.05
    )
    assert outcomes[2].cost == np.inf and outcomes[2].reason == "the step could not be solved"
    assert lines[0].startswith("4 starts, those after the first drawn with seed ")
    assert sum(line.startswith("  start ") for line in lines) == 4
    assert lines[-1].startswith("  kept start 2; ") or lines[-1].startswith("  kept start 4; ")


def test_a_start_of_the_case_that_cannot_be_simulated_ends_it() -> None:
    with pytest.raises(SolverError, match="could not be solved"):
        from_each_start(two_valleys, [{"a": 9.0}, {"a": 1.0}], of_fit, "a", 1, 1)


def test_a_start_that_is_not_run_ends_it() -> None:
    with pytest.raises(NotRunError):
        from_each_start(two_valleys, [{"a": 1.0}, {"a": -9.0}], of_fit, "a", 1, 1)
