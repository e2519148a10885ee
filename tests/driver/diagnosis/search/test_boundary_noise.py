from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from unittest.mock import patch

import numpy as np
import pytest

from driver.diagnosis.answer.result_types import Diagnosis, Refit
from driver.diagnosis.causes.all_causes import NAMES
from driver.diagnosis.causes.noise_causes import BOUNDARY_NOISE
from driver.diagnosis.search import boundary_noise
from driver.diagnosis.search import selection_round as one_round
from driver.diagnosis.search.baseline import with_load_noise
from driver.diagnosis.search.boundary_noise import (
    explains_better,
    in_fast_loads,
    level_again,
    refit_boundary_noise,
    score_boundary_noise,
    sensitivities_where_they_pay,
)
from driver.diagnosis.search.load_outliers import bad_loads
from driver.diagnosis.statistics.goodness_of_fit import FAMILY_LEVEL
from driver.diagnosis.statistics.score_test import effects_of
from driver.diagnosis.statistics.screening import screened
from driver.diagnosis.statistics.variance_component import Component
from driver.forward.model import ForwardModel, Values
from driver.forward.progress_adapter import ProgressAdapter
from driver.identification.boundary_jitter import (
    BoundaryJitter,
    boundary_jitter,
    stops_of,
    unit_elongation,
)
from driver.identification.fit import Fit
from driver.identification.image_data import ImageData
from driver.identification.objective import Evaluation, Objective
from driver.parameters.covariance import SIGMA_E
from solver_adapters.finite_differences import FiniteDifferences
from solver_adapters.interface import Simulation
from tools import closed_form, closed_form_diagnosis
from tools.closed_form_diagnosis import diagnosis_of, identified

BENCH = closed_form.problem()
SETTINGS = replace(closed_form_diagnosis.SETTINGS, refit=5, held_out=2)
NOISE = 1e-4  # µm: this stiff specimen answers to it with ten times the noise of its loads
RUN = ForwardModel.simulation


@cache
def baseline(
    sigma_e: float, hidden: str = "", size: float = 0.0, seed: int = 200
) -> tuple[Objective, Fit]:
    """A fit to data whose specimen was moved by a noise at each stop that no knot knows of."""
    drawn = sigma_e * np.random.default_rng(seed).standard_normal(BENCH.history.n_images)
    shape = unit_elongation(BENCH.model, BENCH.truth)
    noise = (drawn @ stops_of(BENCH.model).astype(float))[:, None, None] * shape

    def moved(model: ForwardModel, values: Values, free: tuple[str, ...] = ()) -> Simulation:
        simulation = RUN(model, values, free)
        return replace(simulation, motion=simulation.motion + noise)

    truth = BENCH.truth | ({hidden: size} if hidden else {})
    with patch.object(ForwardModel, "simulation", moved):
        made = closed_form.objective(BENCH, truth)
    return identified(BENCH, made)


@cache
def diagnosed(sigma_e: float, hidden: str = "", size: float = 0.0) -> Diagnosis:
    return diagnosis_of(BENCH, baseline(sigma_e, hidden, size), SETTINGS)


class Drawn:
    """Residuals drawn from the covariance that is assumed, linear in the noise."""

    def __init__(self) -> None:
        self.objective, fitted = baseline(0.0)
        self.at, data = fitted.best, self.objective.data
        names = screened(self.objective.model, self.at.free, None)
        augmented = self.objective.evaluate(self.at.values, names[1])
        self.causes = effects_of(names[0], augmented, self.objective.parameters)
        self.stops = boundary_jitter(self.objective.model, data.image, fitted.values, SIGMA_E.scale)
        self.effect = data.effect_of_stops(self.stops)

    def fit(self, sigma_e: float, load_noise: float, seed: int) -> Evaluation:
        rng = np.random.default_rng(seed)
        residual = rng.standard_normal(self.at.residual.size)
        residual[: self.at.n_load] *= load_noise
        jitter = sigma_e / SIGMA_E.scale * rng.standard_normal(len(self.effect))
        return replace(self.at, residual=residual + jitter @ self.effect)

    def found(self, sigma_e: float, load_noise: float, seed: int) -> Component:
        at = self.fit(sigma_e, load_noise, seed)
        return in_fast_loads(self.stops, at, self.objective.data)

    def p(self, sigma_e: float, load_noise: float, seed: int) -> float:
        at, data = self.fit(sigma_e, load_noise, seed), self.objective.data
        return score_boundary_noise(self.stops, at, data, self.causes, len(NAMES) + 1).p

    def explains_better(self, at: Evaluation, frames: Sequence[int]) -> bool:
        return explains_better(self.stops, at, self.objective.data, frames)


@cache
def drawn() -> Drawn:
    return Drawn()


@pytest.mark.parametrize("load_noise", [1.0, 2.2])
@pytest.mark.parametrize("sigma_e", [1e-4, 3e-4])
def test_the_level_is_unbiased_over_draws_and_so_is_the_noise_beside_it(
    sigma_e: float, load_noise: float
) -> None:
    found = [drawn().found(sigma_e, load_noise, seed) for seed in range(40)]
    level = np.array([SIGMA_E.scale * one.level for one in found]) / sigma_e
    assert abs(level.mean() - 1) < 3 * level.std() / np.sqrt(40) < 0.2
    spread = np.mean([SIGMA_E.scale * one.spread for one in found]) / sigma_e
    assert level.std() == pytest.approx(spread, rel=0.4)
    noise = np.array([one.noise for one in found]) / load_noise
    assert abs(noise.mean() - 1) < 3 * noise.std() / np.sqrt(40) + 0.1


@pytest.mark.parametrize("load_noise", [1.0, 2.2])
def test_without_it_nothing_is_found_whatever_the_noise_of_the_loads(load_noise: float) -> None:
    p = np.array([drawn().p(0.0, load_noise, seed) for seed in range(40)])
    assert np.all(p > 0.01) and np.median(p) == 1.0


def test_where_it_is_strong_it_stands_with_any_cause_freed() -> None:
    p = np.array([drawn().p(3e-4, 1.0, seed) for seed in range(20)])
    assert np.mean(p < 0.01) > 0.8


def test_loads_that_a_noise_of_the_boundary_moved_are_no_errors_of_single_loads() -> None:
    found = []
    for seed in range(100):
        at = drawn().fit(3e-4, 1.0, seed)
        largest = np.argsort(np.abs(at.residual[: at.n_load]))[-2:].tolist()
        found.append(drawn().explains_better(at, largest))
    assert np.mean(found) > 0.95


@pytest.mark.parametrize("load_noise", [1.0, 2.2])
def test_errors_of_single_loads_are_not_taken_for_a_noise_of_the_boundary(
    load_noise: float,
) -> None:
    found = []
    for seed in range(100):
        at, rng = drawn().fit(0.0, load_noise, seed), np.random.default_rng(999 + seed)
        wrong = rng.choice(at.n_load, 2, replace=False).tolist()
        at.residual[wrong] += 15.0 * load_noise * rng.choice([-1, 1], 2)
        found.append(drawn().explains_better(at, wrong))
    assert np.mean(found) < 0.03


def test_loads_that_a_noise_of_the_boundary_explains_are_taken_back_and_it_is_named() -> None:
    objective, fitted = baseline(2e-4, seed=208)
    assert bad_loads(fitted.best, objective.data)
    found = diagnosis_of(BENCH, (objective, fitted), SETTINGS)
    assert found.verdict.names == ("boundary_noise",)
    assert not found.bad_loads and not found.objective.data.bad_loads


def test_a_wrong_load_among_noisy_ones_stays_left_out() -> None:
    made = closed_form.objective(BENCH, BENCH.truth)
    load, rng = made.data.load.copy(), np.random.default_rng(4)
    load += 2.0 * closed_form.LOAD_NOISE * rng.standard_normal(load.size)
    load[20] += 40.0 * closed_form.LOAD_NOISE
    made = replace(made, data=replace(made.data, load=load))
    found = diagnosis_of(BENCH, identified(BENCH, made), SETTINGS)
    assert [bad.frame for bad in found.bad_loads] == [20]
    assert found.objective.data.load_noise > 1.5 * closed_form.LOAD_NOISE
    assert found.verdict.kind == "nothing wrong"


def test_real_noise_is_found_without_bias_by_the_loads_that_are_fast() -> None:
    """The specimen yields, and rectifies it: the slow part of the same data makes 1.3 of it."""
    found = []
    for seed in range(1000, 1008):
        objective, fitted = baseline(6e-5, seed=seed)
        stops = boundary_jitter(objective.model, objective.data.image, fitted.values, SIGMA_E.scale)
        found.append(in_fast_loads(stops, fitted.best, objective.data).level)
    level = SIGMA_E.scale * np.array(found) / 6e-5
    assert abs(level.mean() - 1) < 3 * level.std() / np.sqrt(8) < 0.35


def test_a_hidden_noise_of_the_boundary_is_named_and_its_level_found() -> None:
    found = diagnosed(NOISE)
    assert found.verdict.kind == "named" and found.verdict.names == ("boundary_noise",)
    assert found.rounds[0].named == ("boundary_noise",) and len(found.rounds[0].refits) == 1
    level, sigma = found.levels["sigma_e"]
    assert abs(level - NOISE) < 3 * sigma < level
    assert found.rounds[-1].goodness_of_fit.accepted and found.log_evidence > 5
    assert found.explained == pytest.approx(1.0, abs=0.1)
    assert found.objective.data.jitter is not None
    # Not five times the stated noise, as it is without σ_e.
    assert found.objective.data.load_noise == pytest.approx(closed_form.LOAD_NOISE, abs=0.5)
    assert found.baseline.best.chi_load > 1.3 and found.extended.best.chi_load < 1.2
    assert found.held_out is not None
    before, after = found.held_out
    assert before.chi_load > 5 and after.chi_load < 0.3 * before.chi_load


def test_the_law_is_that_of_the_truth_once_the_noise_is_counted() -> None:
    found = diagnosed(NOISE)
    parameters = found.objective.parameters
    for name in closed_form.LAW:
        off = abs(found.extended.values[name] - BENCH.truth[name])
        assert off < 3.5 * found.extended.sigma(name, parameters)


def test_without_it_no_stop_is_simulated_and_the_reason_is_said() -> None:
    found = diagnosed(0.0)
    assert found.verdict.kind == "nothing wrong" and not found.levels
    why = {one.cause: one.why for one in found.not_examined}["boundary_noise"]
    assert why.startswith("the loads scatter by 0.") and why.endswith("none is seen")
    assert found.objective.data.jitter is None


def test_a_slow_error_is_not_taken_for_noise() -> None:
    found = diagnosed(0.0, "stretch_curvature", 0.1)
    assert found.verdict.names == ("stretch_not_proportional",) and not found.levels


def test_noise_and_a_slow_error_come_out_as_two() -> None:
    found = diagnosed(NOISE, "tilt_drift", 2e-3)
    assert found.verdict.kind == "named"
    assert found.verdict.names == ("boundary_noise", "tilt_drift")
    level, sigma = found.levels["sigma_e"]
    assert abs(level - NOISE) < 3 * sigma
    off = abs(found.extended.values["tilt_drift"] - 2e-3)
    assert off < 3.5 * found.extended.sigma("tilt_drift", found.objective.parameters)


def test_a_suspected_noise_that_is_not_worth_adding_leaves_the_round_to_the_causes() -> None:
    def worthless(stops: BoundaryJitter, at: Evaluation, objective: Objective) -> Refit:
        return replace(refit_boundary_noise(stops, at, objective), log_evidence=0.9)

    with patch.object(one_round, "refit_boundary_noise", worthless):
        found = diagnosis_of(BENCH, baseline(NOISE, "tilt_drift", 2e-3), SETTINGS)
    # What the noise leaves in the loads may be taken for something else besides.
    assert "tilt_drift" in found.verdict.names and not found.levels
    noise = next(s for s in found.rounds[0].scores if s.cause == BOUNDARY_NOISE)
    assert noise.p < FAMILY_LEVEL


def test_the_answers_to_each_stop_are_simulated_again_at_the_first_two_fits_with_the_noise(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    objective, fitted = baseline(NOISE)
    stops = boundary_jitter(objective.model, objective.data.image, fitted.values, SIGMA_E.scale)
    strengths: list[float] = []

    def simulated(model: ForwardModel, image: ImageData, at: Values, by: float) -> BoundaryJitter:
        strengths.append(at["tau0"])
        return stops

    monkeypatch.setattr(boundary_noise, "boundary_jitter", simulated)
    refit_boundary_noise(stops, fitted.best, objective)
    assert len(strengths) == 2 and fitted.values["tau0"] not in strengths


def test_a_noise_that_the_data_do_without_is_taken_back() -> None:
    objective, fitted = baseline(NOISE)
    stops = boundary_jitter(objective.model, objective.data.image, fitted.values, SIGMA_E.scale)
    found = refit_boundary_noise(stops, fitted.best, objective)
    kept, levels = level_again(found.fit.best, found.objective, found.levels)
    assert kept.data.jitter is not None
    assert levels["sigma_e"][0] == pytest.approx(found.levels["sigma_e"][0], rel=0.05)
    # The same assumed of data that have none.
    quiet, at = baseline(0.0)
    assumed = replace(quiet, data=replace(quiet.data, jitter=found.objective.data.jitter))
    best = assumed.with_free(at.best, at.best.free)
    bare, none = level_again(best, assumed, found.levels)
    assert bare.data.jitter is None and not none


def test_it_is_not_examined_where_it_is_stated_unwanted_or_beyond_the_solver() -> None:
    objective, fitted = baseline(NOISE)
    stated_noise = objective.data.load_noise
    data = with_load_noise(objective.data, fitted.best)
    objective = replace(objective, data=data)

    def why(one: Objective) -> str:
        stops = sensitivities_where_they_pay(fitted.best, one, stated_noise, None)
        assert stops.effect is None and stops.why is not None
        return stops.why.why

    stated = boundary_jitter(BENCH.model, data.image, fitted.values, NOISE)
    assert "jitter_nm" in why(replace(objective, data=replace(data, jitter=stated)))
    by_differences = FiniteDifferences(objective.model.adapter)
    for adapter in (by_differences, ProgressAdapter(by_differences)):
        beyond = replace(objective.model, adapter=adapter)
        assert "the solver has none" in why(replace(objective, model=beyond))
    assert "no loads" in why(replace(objective, data=data.images_alone()))
    assert "too few" in why(replace(objective, data=replace(data, load_degrees=np.inf)))
    unwanted = sensitivities_where_they_pay(fitted.best, objective, stated_noise, ("load_gain",))
    assert unwanted.effect is None and unwanted.why is None
    wanted = sensitivities_where_they_pay(fitted.best, objective, stated_noise, ("boundary_noise",))
    assert wanted.effect is not None
    assert wanted.effect.load.shape == (BENCH.history.n_images,) * 2
    assert np.diag(wanted.effect.load)[5] == pytest.approx(3 * np.diag(stated.load)[5], rel=1e-6)
