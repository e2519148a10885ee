from __future__ import annotations

from dataclasses import replace
from functools import cache
from unittest.mock import patch

import numpy as np
import pytest

from driver.diagnosis.boundary_noise import p_of_loads, stops_where_they_pay
from driver.diagnosis.diagnose import Diagnosis, Settings, diagnose
from driver.identification.boundary_jitter import boundary_jitter, stops_of, unit_elongation
from driver.identification.fit import Fit, Objective
from driver.model import ForwardModel, Values
from solver_adapters.finite_differences import FiniteDifferences
from solver_adapters.interface import Simulation
from tests.driver import closed_form

BENCH = closed_form.bench()
FINE = replace(BENCH.model, adapter=closed_form.ClosedFormSolver(0.001))
SETTINGS = Settings(
    wanted=None, refit=5, held_out=2, processes=1, threads=1, free_chi=1.0, sizes=closed_form.SIZES
)
SIGMA_E = 3e-5  # µm: this stiff specimen answers to it with twice the noise of its loads
RUN = ForwardModel.simulation


@cache
def baseline(sigma_e: float, hidden: str = "", size: float = 0.0) -> tuple[Objective, Fit]:
    """A fit to data whose specimen was moved by a noise at each stop that no knot knows of."""
    drawn = sigma_e * np.random.default_rng(200).standard_normal(BENCH.history.n_images)
    shape = unit_elongation(BENCH.model, BENCH.truth)
    noise = (drawn @ stops_of(BENCH.model).astype(float))[:, None, None] * shape

    def moved(model: ForwardModel, values: Values, free: tuple[str, ...] = ()) -> Simulation:
        simulation = RUN(model, values, free)
        return replace(simulation, motion=simulation.motion + noise)

    truth = BENCH.truth | ({hidden: size} if hidden else {})
    with patch.object(ForwardModel, "simulation", moved):
        made = closed_form.objective(BENCH, truth)
    return closed_form.identified(BENCH, made, FINE)


@cache
def diagnosed(sigma_e: float, hidden: str = "", size: float = 0.0) -> Diagnosis:
    objective, fitted = baseline(sigma_e, hidden, size)
    return diagnose(fitted, objective, FINE, BENCH.history.cycle, SETTINGS, lambda line: None)


def test_a_hidden_noise_of_the_boundary_is_named_and_its_level_found() -> None:
    found = diagnosed(SIGMA_E)
    assert found.verdict.kind == "named" and found.verdict.causes == ("boundary_noise",)
    level, sigma = found.levels["sigma_e"]
    assert abs(level - SIGMA_E) < 3 * sigma < level
    assert found.baseline.best.chi_load > 2 and found.extended.best.chi_load < 1.2
    assert found.steps[-1].omnibus.accepted and found.log_evidence > 20
    assert found.objective.data.jitter is not None
    assert found.held_out is not None


def test_the_law_is_nearer_to_the_truth_once_the_noise_is_counted() -> None:
    found = diagnosed(SIGMA_E)
    parameters = found.objective.parameters
    for name in closed_form.LAW:
        off = abs(found.extended.values[name] - BENCH.truth[name])
        assert off < 3.5 * found.extended.sigma(name, parameters)
        # Without it the fit was far surer of itself.
        assert found.baseline.sigma(name, parameters) < found.extended.sigma(name, parameters)


def test_without_it_no_stop_is_simulated_and_the_reason_is_said() -> None:
    found = diagnosed(0.0)
    assert found.verdict.kind == "nothing wrong" and not found.levels
    why = {one.cause: one.why for one in found.not_examined}["boundary_noise"]
    assert why.startswith("the loads are within their noise")
    objective, fitted = baseline(0.0)
    assert p_of_loads(fitted.best) > 0.05 and objective.data.jitter is None


def test_a_slow_error_is_not_taken_for_noise() -> None:
    found = diagnosed(0.0, "stretch_curvature", 0.1)
    assert found.verdict.causes == ("stretch_not_proportional",) and not found.levels
    scored = {s.cause.name: s for s in found.steps[0].scores}
    assert scored["boundary_noise"].log_evidence < scored["stretch_not_proportional"].log_evidence


def test_noise_and_a_slow_error_come_out_as_two() -> None:
    found = diagnosed(SIGMA_E, "tilt_drift", 2e-3)
    assert found.verdict.kind == "named"
    assert set(found.verdict.causes) == {"boundary_noise", "tilt_drift"}
    level, sigma = found.levels["sigma_e"]
    assert abs(level - SIGMA_E) < 3 * sigma


def test_it_is_not_examined_where_it_is_stated_unwanted_or_beyond_the_solver() -> None:
    objective, fitted = baseline(SIGMA_E)

    def why(one: Objective) -> str:
        stops = stops_where_they_pay(fitted.best, one, None)
        assert stops.effect is None and stops.why is not None
        return stops.why.why

    stated = boundary_jitter(BENCH.model, objective.data.image, fitted.values, SIGMA_E)
    assert "jitter_nm" in why(replace(objective, data=replace(objective.data, jitter=stated)))
    by_differences = replace(objective.model, adapter=FiniteDifferences(objective.model.adapter))
    assert "the solver has none" in why(replace(objective, model=by_differences))
    unwanted = stops_where_they_pay(fitted.best, objective, ("load_gain",))
    assert unwanted.effect is None and unwanted.why is None
    wanted = stops_where_they_pay(fitted.best, objective, ("boundary_noise",))
    assert wanted.effect is not None
    assert wanted.effect.load.shape == (BENCH.history.n_images,) * 2
    assert np.diag(wanted.effect.load)[5] == pytest.approx(10 * np.diag(stated.load)[5], rel=1e-6)
