"""A cause whose effect bends is found by its effect far from its null, and no other one is."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from driver.common.progress import collected_lines
from driver.diagnosis.answer.result_types import Refit
from driver.diagnosis.causes.causes import LIBRARY
from driver.diagnosis.search import (
    candidate_correction,
    corrected_looks,
    finite_step_score,
    looks,
)
from driver.diagnosis.search.boundary_noise import BoundaryNoiseSensitivities
from driver.diagnosis.search.corrected_looks import refit_from_look
from driver.diagnosis.search.fine_models import FineModels
from driver.diagnosis.search.finite_step_score import finite_step_scores
from driver.diagnosis.search.refit import Executor
from driver.diagnosis.search.selection_round import examine
from driver.diagnosis.statistics.score_test import NAMING_LEVEL, WORTH, Score
from driver.experiment.history import History, turning_points
from driver.identification.correction import Correction, SecondMesh
from driver.identification.objective import Evaluation
from driver.parameters.registry import declared_parameters
from meshes.arrays import FloatArray
from solver_adapters.interface import PreparedError, Simulation, SolverError
from tests.driver.diagnosis.search.examined import (
    Examined,
    finer_of,
    first_order,
    look,
    score_of,
    scored,
    with_scores,
)
from tools import closed_form
from tools.closed_form import ClosedFormSolver
from tools.closed_form_diagnosis import SETTINGS, finer, identified

TRUTH = 0.4  # four prior scales
WANTED = ("non_schmid", "residual_stress", "cold_work")


def as_others(a1: float) -> dict[str, float]:
    """What a non-Schmid stress does here: one thing near its null, others far from it."""
    return {
        "tau0_112": float(np.exp(0.002 * a1)),
        "tau0_grain2": float(np.exp(8.0 * a1**3)),
        "elastic_scale": float(np.exp(40.0 * a1**6)),
    }


class Bent(ClosedFormSolver):
    """A solver that knows a non-Schmid stress."""

    def answer(self, simulation: Simulation) -> tuple[FloatArray, FloatArray]:
        m = simulation.material
        o = as_others(m.a1)
        m = replace(
            m,
            tau0_112=o["tau0_112"],
            tau0_grain2=o["tau0_grain2"],
            elastic_scale=o["elastic_scale"],
        )
        return super().answer(replace(simulation, material=m))


class Coarse(Bent):
    """The same whose cells make two thirds of a large one, until they are finer."""

    def answer(self, simulation: Simulation) -> tuple[FloatArray, FloatArray]:
        m = simulation.material
        return super().answer(
            simulation
            if self.finer
            else replace(simulation, material=replace(m, a1=m.a1 / (1.0 + 2.0 * m.a1**2)))
        )


class Brittle(Bent):
    """The same where a large one has no solution."""

    def answer(self, simulation: Simulation) -> tuple[FloatArray, FloatArray]:
        if simulation.material.a1 > 0.2:
            raise SolverError("no solution\nat t = 1 s")
        return super().answer(simulation)


def examined(truth: float, solver: type[Bent] = Bent, seed: int = 0) -> Examined:
    """A fit to data in which a non-Schmid stress is hidden, and its scores."""
    return scored(as_others(truth), WANTED, solver, seed)


def not_hiding(score: Score) -> Score:
    """Of a cause that bends, and that does not hide from all others."""
    return replace(score, cause=replace(score.cause, check_always=False))


@pytest.fixture(scope="module")
def hidden() -> Examined:
    return examined(TRUTH)


def test_an_effect_that_its_derivative_does_not_show_is_found_from_afar(hidden: Examined) -> None:
    near = score_of(hidden.scores, "non_schmid")
    assert near.p > 0.1
    found = look(hidden)
    far = score_of(found.scores, "non_schmid")
    assert far is found.scores[0] and far.p < NAMING_LEVEL
    (refit,) = found.refits
    assert abs(refit.fit.values["a1"] - TRUTH) < 3 * refit.fit.sigma(
        "a1", hidden.objective.parameters
    )
    assert refit.log_evidence == far.log_evidence > 5.0


def test_an_effect_that_cells_make_smaller_is_found_under_the_correction_where_it_stands() -> None:
    """The correction at the fit, with its derivative, knows nothing of it."""
    hidden = examined(TRUTH, Coarse)
    (refit,) = look(hidden).refits
    sigma = refit.fit.sigma("a1", hidden.objective.parameters)
    assert abs(refit.fit.values["a1"] - TRUTH) < sigma


def test_a_side_that_is_seen_under_its_own_correction_is_refitted_however_near_it_ends(
    hidden: Examined, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By the correction at the fit the derivative at the null shows another size."""

    def near(refit: Refit, side: Score, task: object) -> Score:
        amounts = np.array([0.9]), np.array([0.1])
        return replace(side, estimate=amounts[0], sigma=amounts[1], log_evidence=refit.log_evidence)

    monkeypatch.setattr(finite_step_score, "_gained", near)
    assert [refit.cause.name for refit in look(hidden).refits] == ["non_schmid"]
    monkeypatch.setattr(finite_step_score, "refit_from_look", lambda *_: None)
    assert not look(hidden).refits


@pytest.mark.parametrize(("amount", "refits"), [(1.9, 0), (2.1, 1)])
def test_the_end_of_a_refit_under_its_own_correction_stands_two_sigma_off_its_null(
    hidden: Examined, monkeypatch: pytest.MonkeyPatch, amount: float, refits: int
) -> None:
    """Another correction alone may gain, at the null as well."""

    def near(refit: Refit, side: Score, task: object) -> Score:
        amounts = np.array([0.1 * amount]), np.array([0.1])
        return replace(side, estimate=amounts[0], sigma=amounts[1])

    monkeypatch.setattr(finite_step_score, "_gained", near)
    assert len(look(hidden).refits) == refits


def test_where_no_finer_mesh_can_be_simulated_the_correction_at_the_fit_does(
    hidden: Examined, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: Any, **__: Any) -> Correction:
        raise SolverError("no solution")

    for module in (corrected_looks, candidate_correction):
        monkeypatch.setattr(module, "correction", fails)
    (refit,) = look(hidden).refits
    assert not refit.has_own_correction
    assert refit.fit.values["a1"] == pytest.approx(TRUTH, rel=0.1)


def test_where_the_look_alone_cannot_be_simulated_finer_its_refit_has_a_correction_of_its_own(
    hidden: Examined, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: Any, **__: Any) -> Correction:
        raise SolverError("no solution")

    monkeypatch.setattr(corrected_looks, "correction", fails)
    (refit,) = look(hidden).refits
    assert refit.has_own_correction
    assert refit.fit.values["a1"] == pytest.approx(TRUTH, rel=0.1)


@pytest.mark.parametrize("processes", [1, 2])
def test_what_an_instrument_shows_has_no_correction_of_its_own(processes: int) -> None:
    """Refits come back from other processes as copies."""
    at = scored({"load_lag": -4.0}, ("load_lag", "cold_work"))
    near = score_of(at.scores, "load_lag")
    twin = replace(near, cause=replace(near.cause, name="twin"))
    at = with_scores(at, twin)
    crew = Executor(processes, 1)
    found = finite_step_scores(at.scores, at.fit, at.objective, finer_of(at), 1.0, True, crew)
    assert [refit.has_own_correction for refit in found.refits] == [False, False]


def test_the_end_of_a_refit_gains_more_than_the_sides_show(
    hidden: Examined, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The effect goes on bending beyond three prior scales."""
    end = score_of(look(hidden).scores, "non_schmid")
    monkeypatch.setattr(finite_step_score, "_refit", lambda *_: None)
    side = score_of(look(hidden).scores, "non_schmid")
    assert end.statistic > side.statistic + 5.0
    assert side.estimate[0] == pytest.approx(6.5, abs=1.0)  # by the secant to three scales
    assert end.estimate[0] == pytest.approx(10 * TRUTH, rel=0.1)


def test_what_a_side_promises_and_a_refit_does_not_keep_does_not_count(
    hidden: Examined, monkeypatch: pytest.MonkeyPatch
) -> None:
    def gone(refit: Refit, side: Score, task: object) -> Score:
        return replace(side, estimate=np.zeros(1), log_evidence=-1.0)

    monkeypatch.setattr(finite_step_score, "_gained", gone)
    found, near = look(hidden), score_of(hidden.scores, "non_schmid")
    assert not found.refits
    assert score_of(found.scores, "non_schmid").log_evidence == near.log_evidence


def test_a_refit_that_is_worth_nothing_does_not_join_the_others(
    hidden: Examined, monkeypatch: pytest.MonkeyPatch
) -> None:
    def little(*begun: Any) -> Refit:
        refit = refit_from_look(*begun)
        assert refit is not None
        return replace(refit, log_evidence=0.9 * WORTH)

    monkeypatch.setattr(finite_step_score, "refit_from_look", little)
    found, near = look(hidden), score_of(hidden.scores, "non_schmid")
    assert not found.refits
    assert score_of(found.scores, "non_schmid").statistic == near.statistic


def test_a_cause_that_does_not_hide_is_looked_at_where_something_is_wrong_alone(
    hidden: Examined,
) -> None:
    near = not_hiding(score_of(hidden.scores, "non_schmid"))
    at = with_scores(hidden, near)
    assert score_of(look(at).scores, "non_schmid") is near
    assert look(at, accepted=False).scores[0].cause == near.cause
    seen = replace(score_of(hidden.scores, "cold_work"), p=0.9 * NAMING_LEVEL)
    assert score_of(look(with_scores(at, seen)).scores, "non_schmid").p < NAMING_LEVEL


@pytest.mark.parametrize("hides", [True, False])
def test_a_bent_cause_that_its_derivative_shows_is_looked_at_though_it_leads(
    hidden: Examined, hides: bool
) -> None:
    """Its derivative shows a part of it, from which a refit may end in a valley of its own."""
    near = score_of(hidden.scores, "non_schmid")
    near = replace(near if hides else not_hiding(near), p=1e-4, log_evidence=5.0)
    first = replace(score_of(hidden.scores, "cold_work"), p=1e-6, log_evidence=9.0)
    for at in (with_scores(hidden, near, first), with_scores(hidden, near)):
        found = look(at)
        assert found.scores[0].cause == near.cause and found.scores[0].log_evidence > 9.0
        assert [refit.cause for refit in found.refits] == [near.cause]


def test_a_cause_that_hides_and_is_seen_from_afar_has_the_others_looked_at(
    hidden: Examined, lines: list[str]
) -> None:
    bowed = next(cause for cause in LIBRARY if cause.name == "boundary_bow")
    other = replace(score_of(hidden.scores, "cold_work"), cause=replace(bowed, parameters=("x0",)))
    look(with_scores(hidden, other))
    assert [line for line in lines if line.startswith("looking")] == [
        "looking from afar at non_schmid", "looking from afar at boundary_bow",
    ]  # fmt: skip


@pytest.mark.parametrize(("times", "refits"), [(1.9, 1), (2.1, 0)])
def test_a_side_that_promises_little_beside_what_is_known_is_scored_and_not_refitted(
    hidden: Examined, monkeypatch: pytest.MonkeyPatch, times: float, refits: int
) -> None:
    with monkeypatch.context() as without:
        without.setattr(finite_step_score, "_refit", lambda *_: None)
        side = score_of(look(hidden).scores, "non_schmid")
    known = replace(score_of(hidden.scores, "cold_work"), log_evidence=times * side.log_evidence)
    found = look(with_scores(hidden, known))
    assert len(found.refits) == refits
    assert score_of(found.scores, "non_schmid").log_evidence >= side.log_evidence > 3.0


@pytest.mark.parametrize(("sigma", "refits"), [(0.31, 1), (0.29, 0)])
def test_a_side_that_puts_a_cause_where_its_derivative_holds_promises_nothing(
    hidden: Examined, monkeypatch: pytest.MonkeyPatch, sigma: float, refits: int
) -> None:
    """At the paper's size three such refits took twelve minutes, and gained nothing."""
    scored, near = looks.seen_at, score_of(hidden.scores, "non_schmid")

    def at_0_4(task: looks.Task, at: Evaluation, amount: float) -> looks.Side:
        side = scored(task, at, amount)
        estimate = np.array([np.copysign(0.4, amount)])
        known = replace(side.score, estimate=estimate, sigma=np.array([sigma]))
        return replace(side, score=known)

    monkeypatch.setattr(finite_step_score, "seen_at", at_0_4)
    monkeypatch.setattr(corrected_looks, "seen_at", at_0_4)
    found = look(hidden)
    assert len(found.refits) == refits
    assert (score_of(found.scores, "non_schmid").statistic == near.statistic) == (refits == 0)


def test_what_hides_is_not_less_significant_for_looks_that_may_follow(hidden: Examined) -> None:
    bowed = next(cause for cause in LIBRARY if cause.name == "boundary_bow")
    spare = replace(score_of(hidden.scores, "cold_work"), cause=replace(bowed, parameters=("x0",)))
    followed = replace(
        hidden, scores=[spare if s.cause.name == "cold_work" else s for s in hidden.scores]
    )
    p, again = (score_of(look(at).scores, "non_schmid").p for at in (hidden, followed))
    assert again == p


def test_a_bent_cause_has_three_tries_of_its_own_in_the_family(hidden: Examined) -> None:
    found = score_of(look(hidden).scores, "non_schmid")
    assert found.family == len(hidden.scores) + 3


def test_the_end_of_a_refit_gains_what_misfit_it_removes_over_the_variance(
    hidden: Examined,
) -> None:
    """What the prior says of the cause is no misfit."""
    at, variance = hidden, 2.0
    found = finite_step_scores(
        at.scores, at.fit, at.objective, finer_of(at), variance, True, Executor(1, 1)
    )
    (refit,) = found.refits
    without = at.objective.restrict(refit.fit.best, at.fit.best.free)
    gained = (at.fit.best.cost - without.cost) / variance
    assert score_of(found.scores, "non_schmid").statistic == pytest.approx(gained, rel=1e-6)


def test_looks_side_by_side_see_what_looks_one_after_the_other_see(hidden: Examined) -> None:
    near = score_of(hidden.scores, "non_schmid")
    twin = replace(near, cause=replace(near.cause, name="twin"))
    at = with_scores(hidden, twin)
    one, two = (
        finite_step_scores(at.scores, at.fit, at.objective, finer_of(at), 1.0, True, Executor(n, 1))
        for n in (1, 2)
    )
    assert [s.log_evidence for s in two.scores] == [s.log_evidence for s in one.scores]
    assert [r.fit.values for r in two.refits] == [r.fit.values for r in one.refits]
    assert len(two.refits) == 2


def test_from_where_on_a_bent_effect_is_seen_is_told_by_a_look() -> None:
    right = examined(0.0)
    near, far = (score_of(s, "non_schmid") for s in (right.scores, look(right).scores))
    assert near.visible[0] > 100.0 and 2.0 < far.visible[0] < 10.0


def test_what_two_meshes_differ_by_counts_in_what_a_look_shows() -> None:
    right = examined(0.0)
    known = right.fit.best.prediction
    apart_by = Correction(0.0 * known.motion, 10.0 * np.sin(np.arange(len(known.load))))
    apart = replace(right, objective=replace(right.objective, second=SecondMesh(apart_by)))
    far, beside = (score_of(look(at).scores, "non_schmid") for at in (right, apart))
    assert beside.visible[0] > 1.05 * far.visible[0]


def test_what_is_seen_is_not_smaller_than_what_is_visible(hidden: Examined) -> None:
    """A side far from the null may show less than the derivative that has found the cause."""
    near = not_hiding(score_of(hidden.scores, "non_schmid"))
    near = replace(near, p=3e-17, log_evidence=1e3, estimate=np.array([-0.5]))
    leader = replace(score_of(hidden.scores, "cold_work"), log_evidence=2e3)
    found = score_of(look(with_scores(hidden, near, leader)).scores, "non_schmid")
    assert found.p == 3e-17 and found.estimate == [-0.5]
    assert found.visible == [0.5]


def test_causes_that_do_not_bend_keep_their_scores(hidden: Examined) -> None:
    found = look(hidden).scores
    assert {s.cause.name for s in found} == {s.cause.name for s in hidden.scores}
    for score in hidden.scores:
        if not score.cause.strongly_nonlinear:
            assert score_of(found, score.cause.name) is score


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_model_that_is_right_gets_nothing_from_afar(seed: int) -> None:
    found = look(examined(0.0, seed=seed))
    assert all(s.p >= NAMING_LEVEL for s in found.scores)
    assert not found.refits


BESIDE_LAG = ("load_lag", "section_depth", "load_offset")


def test_a_lag_is_found_though_the_derivatives_show_another_cause() -> None:
    """The load changes at one rate before an image and at another after it."""
    hidden = scored({"load_lag": -0.65}, BESIDE_LAG)
    assert hidden.scores[0].cause.name != "load_lag"
    found = look(hidden)
    lag = found.scores[0]
    assert lag.cause.name == "load_lag" and lag.p < NAMING_LEVEL
    (refit,) = found.refits
    sigma = refit.fit.sigma("load_lag", hidden.objective.parameters)
    assert abs(refit.fit.values["load_lag"] + 0.65) < 3 * sigma


class Relaxing(ClosedFormSolver):
    """The same whose load falls by a twentieth while the stage stands."""

    def answer(self, simulation: Simulation) -> tuple[FloatArray, FloatArray]:
        motion, times = simulation.motion, simulation.times
        u, _ = super().answer(simulation)
        _, load = super().answer(replace(simulation, output=np.arange(times.size)))
        stood = np.zeros(times.size)
        stood[1:] = np.diff(times) * (np.abs(np.diff(motion, axis=0)).max(axis=(1, 2)) < 1e-9)
        return u, (load * (0.95 + 0.05 * np.exp(-stood / 5.0)))[simulation.output]


def relaxing(hidden: dict[str, float], hold: float) -> Examined:
    """Images each at the end of a hold, in which the load relaxes, and a lag of the loads."""
    travel = closed_form.history().stage
    stage = np.repeat(travel[np.diff(travel, prepend=-1.0) != 0.0], 2)
    image_row = np.arange(1, stage.size, 2)
    turning = turning_points(stage)
    past = History(
        time=np.cumsum(np.where(np.arange(stage.size) % 2, hold, 10.0)) - 10.0,
        stage=stage,
        image_row=image_row,
        force=np.zeros(image_row.size),
        turning=turning,
        cycle=np.where(image_row <= turning[2], 1, 2),
    )
    problem = closed_form.problem(past=past)
    model = replace(problem.model, adapter=Relaxing())
    objective = closed_form.objective(replace(problem, model=model), problem.truth)
    noise = closed_form.LOAD_NOISE * np.random.default_rng(5).standard_normal(image_row.size)
    load = model.predict(problem.truth | hidden).load + noise
    objective = replace(objective, data=replace(objective.data, load=load))
    objective, fitted = identified(problem, objective)
    return first_order(fitted, objective, BESIDE_LAG)


@pytest.mark.parametrize(("lag", "hold"), [(0.65, 3.0), (2.0, 30.0), (-6.0, 3.0)])
def test_a_lag_out_of_a_hold_is_found_though_loads_relax_in_it(lag: float, hold: float) -> None:
    hidden = relaxing({"load_lag": lag}, hold)
    found = look(hidden)
    assert found.scores[0].cause.name == "load_lag" and found.scores[0].p < NAMING_LEVEL
    (refit,) = found.refits
    sigma = refit.fit.sigma("load_lag", hidden.objective.parameters)
    assert abs(refit.fit.values["load_lag"] - lag) < 3 * sigma


def test_a_lag_within_a_hold_where_the_load_has_relaxed_counts_as_unseen() -> None:
    lag = score_of(look(relaxing({"load_lag": -6.0}, 30.0)).scores, "load_lag")
    assert lag.p > NAMING_LEVEL
    width = declared_parameters(1)["load_lag"].width
    assert width * lag.visible[0] > 6.0


def test_a_cause_with_a_kink_has_five_tries_of_its_own_in_the_family(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    hidden = scored({"load_lag": -0.65}, BESIDE_LAG)
    monkeypatch.setattr(finite_step_score, "_refit", lambda *_: None)
    lag = score_of(look(hidden).scores, "load_lag")
    assert lag.family == len(hidden.scores) + 5


def test_a_lag_is_looked_at_in_one_simulation(monkeypatch: pytest.MonkeyPatch) -> None:
    right = scored({}, ("load_lag",))
    runs = [0]

    def counted(self: ClosedFormSolver, simulation: Simulation) -> tuple[FloatArray, FloatArray]:
        runs[0] += 1
        return answer(self, simulation)

    answer = ClosedFormSolver.answer
    monkeypatch.setattr(ClosedFormSolver, "answer", counted)
    together = score_of(look(right).scores, "load_lag")
    assert runs == [1]
    monkeypatch.setattr(type(right.objective.model), "simulated", lambda self, name: True)
    apart = score_of(look(right).scores, "load_lag")
    assert runs == [5]
    np.testing.assert_allclose(together.visible, apart.visible, rtol=1e-12)


def test_a_lag_that_cannot_be_simulated_leaves_its_derivative(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    right = scored({}, ("load_lag",))

    def none(self: ClosedFormSolver, simulation: Simulation) -> tuple[FloatArray, FloatArray]:
        raise SolverError("no solution")

    monkeypatch.setattr(ClosedFormSolver, "answer", none)
    with collected_lines() as lines:
        found = look(right)
    assert (
        score_of(found.scores, "load_lag") == score_of(right.scores, "load_lag")
        and not found.refits
    )
    assert sum("cannot be simulated (no solution)" in line for line in lines) == 4


def test_what_would_have_been_seen_of_a_lag_is_seen_on_the_side_that_shows_less() -> None:
    right = scored({}, BESIDE_LAG)
    lag = score_of(look(right).scores, "load_lag")
    assert lag.p > NAMING_LEVEL
    hidden = scored({"load_lag": float(-3.0 * lag.visible[0])}, BESIDE_LAG)
    seen = score_of(look(hidden).scores, "load_lag").statistic
    assert seen == pytest.approx(4.5**2, rel=0.2)
    assert score_of(hidden.scores, "load_lag").statistic < 0.5 * seen


def test_a_side_that_cannot_be_simulated_is_told_and_the_other_is_looked_at(
    lines: list[str],
) -> None:
    found = look(examined(-TRUTH, Brittle))
    assert "  a1 = 0.3 cannot be simulated (no solution)" in lines
    assert score_of(found.scores, "non_schmid").p < NAMING_LEVEL


class Elsewhere(Bent):
    """A solver on another machine, where a non-Schmid stress is large."""

    def answer(self, simulation: Simulation) -> tuple[FloatArray, FloatArray]:
        if abs(simulation.material.a1) > 0.1:
            raise PreparedError([Path(f"jobs/{simulation.material.a1:+.1f}")])
        return super().answer(simulation)


def test_both_sides_are_prepared_at_once() -> None:
    with pytest.raises(PreparedError) as error:
        look(examined(TRUTH, Elsewhere))
    assert sorted(error.value.folders) == [Path("jobs/+0.3"), Path("jobs/-0.3")]


def test_a_round_names_what_only_a_look_from_afar_shows(hidden: Examined) -> None:
    settings = replace(SETTINGS, wanted=("non_schmid",))
    meshes = FineModels(replace(finer(closed_form.problem()), adapter=Bent(0.001)))
    found = examine(
        hidden.fit,
        hidden.objective,
        (),
        settings,
        BoundaryNoiseSensitivities(None),
        None,
        meshes,
    )
    assert found.winner is not None and found.winner.cause.name == "non_schmid"
    assert found.winner.fit.values["a1"] == pytest.approx(TRUTH, abs=0.04)


def test_along_a_parameter_at_its_bound_the_residual_is_seen_from_afar_as_well(
    hidden: Examined,
) -> None:
    """A look is scored as if what is held at its bound were given."""
    objective, fitted = hidden.objective, hidden.fit
    known = objective.parameters
    held = replace(known["tau0"], upper=fitted.values["tau0"])
    objective = replace(objective, parameters={**known, "tau0": held})
    assert fitted.at_bounds(objective.parameters) == ("tau0",)
    at = replace(hidden, objective=objective)
    given = replace(at, fit=replace(fitted, best=fitted.inside(objective)))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(looks, "PROMISING", 0.0)  # no refit, which frees it again
        one, other, free = (
            score_of(look(seen).scores, "non_schmid") for seen in (at, given, hidden)
        )
    assert one.visible == pytest.approx(other.visible)
    assert one.visible != pytest.approx(free.visible, rel=1e-3)
