from __future__ import annotations

from dataclasses import replace

import pytest

from driver.diagnosis.answer.result_types import Refit
from driver.diagnosis.search.noise_continuation import refit_by_noise_continuation
from driver.diagnosis.search.refit import Executor, refit_causes
from meshes.arrays import FloatArray
from solver_adapters.interface import Simulation, SolverError
from tools import closed_form
from tools.closed_form_diagnosis import large_effect

BENCH = closed_form.problem()
CREW = Executor(1, 1)


def best_of(refits: list[Refit]) -> Refit:
    return max(refits, key=lambda one: one.log_evidence)


@pytest.mark.parametrize(
    ("cause", "name", "value"),
    [
        ("stretch_not_proportional", "stretch_curvature", 0.5),
        ("load_lag", "load_lag", 25.0),
    ],
)
def test_a_large_effect_is_found_and_measured_where_refits_from_the_baseline_are_far_from_done(
    cause: str, name: str, value: float, lines: list[str]
) -> None:
    objective, baseline, augmented, tried = large_effect(name, value)
    assert baseline.best.chi_load > 50
    near = best_of(refit_causes(tried[:5], augmented, baseline.best, objective, CREW))
    assert near.fit.best.chi_load > 3
    executor = Executor(1, 1)
    found = best_of(
        refit_by_noise_continuation(tried, augmented.free, baseline.best, objective, 5, executor)
    )
    assert found.cause.name == cause and found.fit.best.chi_load < 1.3
    sigma = found.fit.sigma(name, objective.parameters)
    assert abs(found.fit.values[name] - value) < max(4 * sigma, 0.01 * value)
    assert found.log_evidence > near.log_evidence + 100
    assert any(cause in line for line in lines if line.startswith("refitting "))


def test_what_gains_less_than_half_of_the_best_below_soft_loads_is_not_followed_further() -> None:
    objective, baseline, augmented, tried = large_effect("stretch_curvature", 0.5)
    refits = refit_by_noise_continuation(tried, augmented.free, baseline.best, objective, 5, CREW)
    assert [refit.cause.name for refit in refits] == ["stretch_not_proportional"]


def test_where_the_nominal_model_cannot_be_simulated_the_baseline_is_begun_with(
    lines: list[str],
) -> None:
    objective, baseline, augmented, tried = large_effect("stretch_curvature", 0.5)
    refused = [SolverError("no step is short enough\nat t = 1 s")]

    class Refusing(closed_form.ClosedFormSolver):
        """It fails where it is asked first, at the nominal model."""

        def answer(self, simulation: Simulation) -> tuple[FloatArray, FloatArray]:
            if refused:
                raise refused.pop()
            return super().answer(simulation)

    shy = replace(objective, model=replace(objective.model, adapter=Refusing()))
    executor = Executor(1, 1)
    found = best_of(
        refit_by_noise_continuation(tried, augmented.free, baseline.best, shy, 5, executor)
    )
    assert "  not from the nominal model (no step is short enough)" in lines
    assert found.cause.name == "stretch_not_proportional" and found.fit.best.chi_load < 1.3
