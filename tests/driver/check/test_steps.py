"""Steps an interval that a scheme of first order needs, told before a run."""

from __future__ import annotations

import numpy as np
import pytest

from driver.case.model import Case
from driver.check.steps import load_error_of_steps, recommended_steps
from driver.doubts.finding import Finding
from driver.virtual.truth import stage_program
from solver_adapters.bundled.adapter import BundledAdapter
from solver_adapters.calculix.adapter import CalculixAdapter
from solver_adapters.code_aster.adapter import CodeAsterAdapter
from solver_adapters.interface import Adapter, Simulation, SolverError
from tools.short_specimen import small_case

HISTORY = stage_program([(4, 1)])


def case(solver: str, steps: int = 1, noise: float = 5.97, **changes: object) -> Case:
    plain = small_case()
    table = {"name": solver, "steps_per_interval": steps, **changes}
    solver_table = plain.solver.model_copy(update=table)
    loads = plain.loads.model_copy(update={"noise_uN": noise})
    return plain.model_copy(update={"solver": solver_table, "loads": loads})


def finding(asked: Case, adapter: Adapter) -> list[Finding]:
    return list(recommended_steps(asked, adapter, HISTORY))


def test_the_error_falls_with_the_length_of_the_steps_to_first_order() -> None:
    errors = [load_error_of_steps(case("code_aster"), HISTORY, steps) for steps in (1, 2, 4)]
    assert all(1.3 < coarse / fine < 3.0 for coarse, fine in zip(errors, errors[1:], strict=False))


def test_the_error_is_that_of_the_limit_of_small_steps_within_a_factor_of_two() -> None:
    class Loads(BundledAdapter):
        found: list[np.ndarray] = []

        def solve(self, simulation: Simulation, *others: object) -> object:  # type: ignore[override]
            response = super().solve(simulation)
            self.found.append(response.force)
            return response

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("driver.check.steps.find_in_process", lambda scheme: Loads())
        told = load_error_of_steps(case("code_aster"), HISTORY, 1)
        load_error_of_steps(case("code_aster"), HISTORY, 16)
        # Of the first call steps in halves and quarters, of the second 1/32 and 1/64 of them.
        halves, limit = Loads.found[1], Loads.found[2]
    of_halves = float(np.sqrt(np.mean((halves - limit) ** 2)))
    assert told / 2 / of_halves == pytest.approx(1.0, rel=0.5)


@pytest.mark.parametrize(
    ("solver", "adapter", "least"),
    [("code_aster", CodeAsterAdapter(), 1), ("calculix", CalculixAdapter(), 20)],
)
def test_the_steps_of_each_solver_are_recommended_by_its_scheme_and_by_what_it_needs_beside(
    solver: str, adapter: Adapter, least: int
) -> None:
    error = load_error_of_steps(case(solver), HISTORY, 1)
    noise = error / 1.7
    (found,) = finding(case(solver, noise=noise), adapter)
    assert found.level == "warning"
    assert f"found 1, with which backward Euler leaves about {error:.2g} µN rms" in found.message
    # Half of the noise is 3.4 times smaller than the error.
    assert f"; expected about {max(4, least)}. " in found.message
    assert (f"{solver} needs at least {least}" in found.message) == (least > 1)
    (enough,) = finding(case(solver, max(8, least), noise=noise), adapter)
    assert enough.level == "ok"


def test_a_scheme_that_follows_the_back_stress_needs_no_word() -> None:
    adapter = BundledAdapter()
    assert finding(case("bundled"), adapter) == []
    assert len(finding(case("bundled", integration="backward_euler"), adapter)) == 1
    refined = case("bundled", integration="backward_euler", accuracy_uN=1.0)
    assert finding(refined, adapter) == []


def test_a_specimen_that_cannot_be_simulated_is_told_and_stops_no_check(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class Failing(BundledAdapter):
        def solve(self, simulation: Simulation, *others: object) -> object:  # type: ignore[override]
            raise SolverError("no step is short enough")

    monkeypatch.setattr("driver.check.steps.find_in_process", lambda scheme: Failing())
    (found,) = finding(case("code_aster"), CodeAsterAdapter())
    assert found.level == "warning" and "no step is short enough" in found.message
