from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any, cast

import numpy as np
import pytest

import driver.identification.identify as of_stages
from driver.common.progress import progress_to
from driver.experiment.history import knot_weights
from driver.identification.correction import Correction, correction
from driver.identification.data import Data
from driver.identification.fit import Fit, fit
from driver.identification.identify import (
    Identification,
    Plan,
    elastic_stiffness,
    identify,
    knot_start,
    noise_factor,
    start_values,
    unload_elastically,
)
from driver.identification.mesh_error import share_left
from driver.parameters.boundary import LAMBDAS, elongation_names, tilt_names
from driver.parameters.pose import POSE_DECLARATIONS
from solver_adapters.interface import Response, Simulation
from tests.driver.analytic import evaluation
from tools import closed_form
from tools.closed_form import KNOTS, LAW, LENGTH, SIZES, TILTS, WIDTH
from tools.closed_form_diagnosis import priors

BENCH = closed_form.problem()
WEIGHTS = knot_weights(BENCH.history)
NAMES = elongation_names(5)
TRUE = {"tau0": 46.0, "c": 34e3, "d": 1300.0, "lambda_plus_Y": 0.9, "lambda_minus_Z": 1.1}


def test_knots_are_read_off_a_measured_motion_whatever_its_reference() -> None:
    motion = WEIGHTS @ [0.0, *KNOTS] + 0.004
    assert knot_start(WEIGHTS, motion, NAMES) == pytest.approx(dict(zip(NAMES, KNOTS, strict=True)))


def test_every_parameter_starts_at_its_null_but_the_knots() -> None:
    values, free = start_values(BENCH.model, WEIGHTS @ [0.0, *KNOTS], WEIGHTS @ [0.0, *TILTS])
    assert values == pytest.approx(BENCH.truth)
    assert free == (*NAMES, *tilt_names(5))


def test_an_unloading_is_as_long_as_its_drop_of_load() -> None:
    values = dict(zip(NAMES, (0.020, 0.030, 0.050, 0.020), strict=True)) | {"tau0": 40.0}
    load = WEIGHTS @ [0.0, 200.0, 20.0, 260.0, 30.0]
    found = unload_elastically(values, 90e3, WEIGHTS, load)
    expected = (0.020, 0.020 - 180 / 90e3, 0.050, 0.050 - 230 / 90e3)
    assert [found[name] for name in NAMES] == pytest.approx(list(expected))
    assert found["tau0"] == 40.0 and values["elongation_2"] == 0.030


def test_the_stiffness_is_that_of_the_unyielded_specimen() -> None:
    m = BENCH.model.material
    modulus = 0.6 * (m.C11 + m.C44) + 0.3 * m.c
    section = WIDTH * BENCH.case.specimen.depth / 2
    # One step from rest: whatever the start of the knots and of the law.
    values = BENCH.truth | {"elongation_1": 0.5, "tau0": 4000.0}
    found = elastic_stiffness(BENCH.model, values)
    assert found == pytest.approx(modulus * section / LENGTH, rel=0.02)


@pytest.mark.parametrize("noise", [0.8, 1.3])
def test_the_noise_is_recovered_under_a_slow_model_error(noise: float) -> None:
    T, n_z = 80, 40
    rng = np.random.default_rng(5)
    clock = np.linspace(0, 1, T)[:, None]
    slow = 20 * (clock**2 - 0.3 * np.cos(3 * clock)) * rng.standard_normal(n_z)
    images = slow + noise * rng.standard_normal((T, n_z))
    image: Any = type("Image", (), {"n_z": n_z})
    data = Data(cast(Any, image), np.zeros(T), 1.0, 0.0, np.arange(T))
    residual = np.concatenate([1e3 * np.ones(T), images.ravel()])
    best = evaluation(residual, np.zeros((1, residual.size)), n_load=T)
    assert noise_factor(Fit(best, True, "", ()), data) == pytest.approx(noise, rel=0.05)
    assert np.sqrt(np.mean(images**2)) > 3


def test_the_correction_is_finer_minus_working() -> None:
    finer = replace(BENCH.model, adapter=closed_form.ClosedFormSolver(0.01))
    objective = closed_form.objective(BENCH, BENCH.truth)
    at = Fit(objective.evaluate(BENCH.truth, ()), True, "", ())
    found = correction(BENCH.model, finer, at.best.prediction, at.values)
    np.testing.assert_allclose(found.load, -0.01 * at.best.load, atol=1e-9)
    motion = np.asarray(found.motion)
    assert 1e-5 < np.abs(motion[..., 1]).max() < 1e-3 and np.abs(motion[..., 0]).max() < 1e-15


def test_a_correction_is_taken_again_at_the_end_of_a_stage_that_ends_far_from_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What a correction to first order leaves falls with the square of the way."""
    solver = closed_form.ClosedFormSolver(0.5)
    finer = replace(BENCH.model, adapter=solver)

    def left(found: Identification) -> float:
        at = found.final
        there = finer.predict(at.values, ()).load - at.best.prediction.load
        return float(np.abs(found.objective.correction.at(at.values).load - there).max())

    once, lines = identification(0.5)
    assert sum("finer mesh" in line for line in lines) == 1
    monkeypatch.setattr(of_stages, "FAR", 1e-2)
    again, lines = identification.__wrapped__(0.5)
    assert 1 < sum("finer mesh" in line for line in lines) <= of_stages.MOST_CORRECTIONS
    assert any("σ from where its correction was taken" in line for line in lines)
    assert left(again) < 0.2 * left(once)
    # Its noise and covariance are those of the correction that the fit ended with.
    error = again.objective.data.simulation_error
    kappa = share_left(BENCH.model.microstructure.mesh, SIZES)
    assert error is not None
    np.testing.assert_allclose(error.load, kappa * again.objective.correction.of_mesh[1])


@cache
def identification(
    finer_by: float = 0.002, spread: tuple[tuple[str, float], ...] = (), **keys: Any
) -> tuple[Identification, tuple[str, ...]]:
    """The whole procedure on a specimen that differs from the start in law and amplitudes."""
    truth = BENCH.truth | TRUE
    made = closed_form.objective(BENCH, truth, seed=1)
    rng = np.random.default_rng(2)
    measured = [
        WEIGHTS @ [0.0, *knots] + 0.002 * rng.standard_normal(len(WEIGHTS))
        for knots in (KNOTS, TILTS)
    ]
    start, knots = start_values(BENCH.model, *measured)
    made = replace(made, prior=priors(start))
    pose = tuple(p.name for p in POSE_DECLARATIONS)
    finer = replace(BENCH.model, adapter=closed_form.ClosedFormSolver(finer_by))
    lines: list[str] = []
    plan = Plan(law=LAW, knots=(*pose, *knots), sizes=SIZES, most=15, spread=dict(spread), **keys)
    with progress_to(lines.append):
        found = identify(BENCH.model, finer, made, start, plan)
    return found, tuple(lines)


def test_law_knots_and_amplitudes_are_found_within_their_uncertainty() -> None:
    # The data have no discretisation error: let the finer simulation agree.
    found, _ = identification(1e-6)
    final, parameters = found.final, found.objective.parameters
    for name, value in TRUE.items():
        assert abs(final.values[name] - value) < 3.5 * final.sigma(name, parameters), name
    for name in NAMES:
        assert abs(final.values[name] - BENCH.truth[name]) < 3.5 * final.sigma(name, parameters)
        assert final.sigma(name, parameters) < 5e-4  # loads resolve a fraction of a nanometre
    assert final.best.chi_load == pytest.approx(1.0, abs=0.3)
    assert final.converged and found.objective.data.image.noise_factor == pytest.approx(1, abs=0.1)


def test_the_correction_is_part_of_the_last_stage() -> None:
    found, _ = identification()
    change = found.objective.correction
    np.testing.assert_allclose(
        np.asarray(change.load), -0.002 * found.stages["B"].best.load, atol=1e-6
    )
    error = found.objective.data.simulation_error
    assert error is not None and np.abs(error.load).max() > 0
    final = found.final
    np.testing.assert_allclose(
        final.best.load, final.best.prediction.load + change.at(final.values).load
    )
    # The load of the finer simulation where the last stage ends, not where the second one did.
    np.testing.assert_allclose(final.best.load, 0.998 * final.best.prediction.load, rtol=1e-6)
    # Where nothing else is wrong of the load, one that is 0.2 % too small in the finer simulation
    # is made up for by a stronger law.
    stated = replace(found.objective, data=replace(found.objective.data, simulation_error=None))
    taus = [
        fit(replace(stated, correction=used), final.values, final.best.free, 8).values["tau0"]
        for used in (change, Correction())
    ]
    assert taus[0] > taus[1]
    # What the finer simulation may leave wrong of the load is as large as the correction, and
    # widens the interval of what the load decides; the shift itself is lost in it.
    exact, parameters = identification(1e-6)[0], found.objective.parameters
    assert final.sigma("tau0", parameters) > 1.1 * exact.final.sigma("tau0", parameters)
    shift = abs(final.values["tau0"] - exact.final.values["tau0"])
    assert shift < final.sigma("tau0", parameters)


def test_stages_free_what_they_say() -> None:
    found, lines = identification()
    stages = found.stages
    assert list(stages) == ["A", "B", "C"]
    assert stages["A"].best.n_load == 0 and stages["B"].best.n_load == BENCH.history.n_images
    assert not set(LAMBDAS) & set(stages["B"].best.free)
    assert all(stages["B"].values[name] == stages["A"].values[name] for name in LAMBDAS)
    assert set(stages["C"].best.free) == {*LAMBDAS, *stages["B"].best.free}
    assert sum(line.startswith("stage ") for line in lines) == 3


@pytest.mark.parametrize("order", ["joint", "paper"])
def test_from_the_starts_of_the_paper_few_iterations_do(order: str) -> None:
    """The paper took 10 for its amplitudes and 4 to 6 for its law."""
    found, _ = identification(order=order)
    iterations = {stage: len(fit_.history) - 1 for stage, fit_ in found.stages.items()}
    assert iterations["A"] <= 10 and iterations["B"] <= 6 and iterations["C"] <= 6
    assert all(fit_.converged and fit_.reason for fit_ in found.stages.values())


def test_in_the_order_of_the_paper_knots_stay_as_they_were_measured() -> None:
    found, lines = identification(order="paper")
    A, B, C = (found.stages[name] for name in "ABC")
    assert A.best.free == LAMBDAS and B.best.free == C.best.free == LAW
    assert A.best.n_load == 0 and B.best.n_load == BENCH.history.n_images
    assert all(A.values[name] == BENCH.truth[name] for name in LAW)
    joint = identification()[0]
    assert all(C.values[n] == A.values[n] for n in (*NAMES, *tilt_names(5), *LAMBDAS))
    assert any(abs(C.values[n] - joint.final.values[n]) > 1e-4 for n in NAMES)
    # Knots that are 2 nm off are all that the loads can see.
    assert C.best.paper.chi_F > 10 > joint.final.best.paper.chi_F
    assert "knots held" in " ".join(lines)


def test_in_the_order_of_the_paper_stage_b_begins_with_what_a_has_simulated() -> None:
    found, _ = identification(order="paper")
    A, B = found.stages["A"].best, found.stages["B"].history[0]
    np.testing.assert_array_equal(A.values["tau0"], B["tau0"])
    assert B["paper_chi_f"] == A.paper.chi_f and B["paper_chi_F"] == A.paper.chi_F


def test_stage_c_begins_where_b_ended_and_simulates_only_what_b_lacks() -> None:
    asked: list[tuple[str, ...]] = []

    class Counting(closed_form.ClosedFormSolver):
        def solve(self, simulation: Simulation, *rest: Any) -> Response:
            asked.append(tuple(direction.name for direction in simulation.directions))
            return super().solve(simulation, *rest)

    model = replace(BENCH.model, adapter=Counting())
    made = replace(closed_form.objective(BENCH, BENCH.truth | TRUE), model=model)
    made = replace(made, prior=priors(BENCH.truth))
    plan = Plan(law=LAW, knots=(*NAMES, *tilt_names(5)), sizes=SIZES, most=15)
    found = identify(model, BENCH.model, made, BENCH.truth, plan)
    whole = found.objective.evaluate(found.stages["B"].values, plan.free("C"))
    start = found.stages["C"].history[0]
    assert start["cost"] == pytest.approx(whole.cost, rel=1e-9)
    assert asked.count(LAMBDAS) == 1
    # One evaluation of each iteration, and none twice but for the one of this test.
    trials = [names for names in asked if names]
    evaluations = sum(len(fit_.history) for fit_ in found.stages.values())
    assert len(trials) <= evaluations + 2


def test_noise_of_the_boundary_enters_with_the_loads_and_is_taken_anew_at_the_end() -> None:
    found, lines = identification(jitter=1e-4)
    data = found.objective.data
    assert data.jitter is not None and data.jitter.load.shape == (44, 44)
    assert "noise of the boundary motion at the result" in lines
    plain = identification()[0]
    ratio = [
        found.final.sigma(n, found.objective.parameters)
        / plain.final.sigma(n, plain.objective.parameters)
        for n in LAW
    ]
    assert min(ratio) > 1.2
    assert found.stages["A"].best.n_load == 0


def test_several_starts_end_in_the_same_place() -> None:
    spread = (("tau0", 0.5), ("c", 0.3), ("lambda_plus_Y", 1.0))
    found, lines = identification(1e-6, starts=3, spread=spread)
    single = identification(1e-6)[0]
    for name in LAW:
        sigma = single.final.sigma(name, single.objective.parameters)
        assert abs(found.final.values[name] - single.final.values[name]) < 0.3 * sigma
    costs = [outcome.cost for outcome in found.starts]
    assert len(costs) == 3 and found.stages["B"].best.cost == min(costs)
    assert any(line.startswith("  kept start") for line in lines)
