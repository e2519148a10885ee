"""A cause whose effect bends is found by its effect far from its null, and no other one is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from driver.diagnosis.far_looks import look_from_afar
from driver.diagnosis.refit import Crew
from driver.diagnosis.score import NAMING_LEVEL, Score, effects_of
from driver.diagnosis.screening import screen, screened
from driver.identification.fit import Fit
from driver.identification.objective import Objective
from driver.log import silent
from solver_adapters.interface import FloatArray, Simulation, SolverError
from tests.driver import closed_form
from tests.driver.closed_form import ClosedFormSolver
from tests.driver.closed_form_diagnosis import SETTINGS, identified

ALONE = Crew(1, 1, silent)
TRUTH = 0.4  # four prior scales
WANTED = ("non_schmid", "residual_stress", "cold_work")


def as_others(a1: float) -> dict[str, float]:
    """What a non-Schmid stress does here: one thing near its null, another far from it."""
    return {"tau0_112": float(np.exp(0.002 * a1)), "tau0_grain2": float(np.exp(8.0 * a1**3))}


class Bent(ClosedFormSolver):
    """A solver that knows a non-Schmid stress."""

    def answer(self, simulation: Simulation) -> tuple[FloatArray, FloatArray]:
        m = simulation.material
        others = as_others(m.a1)
        m = replace(m, tau0_112=others["tau0_112"], tau0_grain2=others["tau0_grain2"])
        return super().answer(replace(simulation, material=m))


class Brittle(Bent):
    """The same where a large one has no solution."""

    def answer(self, simulation: Simulation) -> tuple[FloatArray, FloatArray]:
        if simulation.material.a1 > 0.2:
            raise SolverError("no solution\nat t = 1 s")
        return super().answer(simulation)


def examined(truth: float, solver: type[Bent] = Bent) -> tuple[list[Score], Fit, Objective]:
    """First-order scores of causes of the law, with a non-Schmid stress hidden in the data."""
    bench = closed_form.bench()
    objective = closed_form.objective(bench, bench.truth | as_others(truth))
    objective, fitted = identified(bench, objective)
    objective = replace(objective, model=replace(objective.model, adapter=solver()))
    candidates, names = screened(objective.model, fitted.best.free, WANTED)
    wide = objective.evaluate(fitted.values, names)
    effects = effects_of(candidates, wide, objective.parameters)
    scores, _ = screen(fitted, objective, candidates, effects, SETTINGS.sizes)
    return scores, fitted, objective


def _of(scores: list[Score], name: str) -> Score:
    return next(s for s in scores if s.cause.name == name)


@pytest.fixture(scope="module")
def hidden() -> tuple[list[Score], Fit, Objective]:
    return examined(TRUTH)


def test_an_effect_that_its_derivative_does_not_show_is_found_from_afar(
    hidden: tuple[list[Score], Fit, Objective],
) -> None:
    scores, fitted, objective = hidden
    near = _of(scores, "non_schmid")
    assert near.p > 0.1
    found = look_from_afar(scores, fitted, objective, 1.0, ALONE)
    far = found.scores[0]
    assert far.cause.name == "non_schmid" and far.p < NAMING_LEVEL
    (refit,) = found.refits
    value, sigma = refit.fit.values["a1"], refit.fit.sigma("a1", objective.parameters)
    assert abs(value - TRUTH) < 3 * sigma + 0.05 and sigma < 0.1
    assert refit.log_evidence > 5.0


def test_causes_that_do_not_bend_keep_their_scores(
    hidden: tuple[list[Score], Fit, Objective],
) -> None:
    scores, fitted, objective = hidden
    found = look_from_afar(scores, fitted, objective, 1.0, ALONE).scores
    assert {s.cause.name for s in found} == {s.cause.name for s in scores}
    for score in scores:
        if not score.cause.bends:
            assert _of(found, score.cause.name) is score


def test_a_model_that_is_right_gets_nothing_from_afar() -> None:
    scores, fitted, objective = examined(0.0)
    found = look_from_afar(scores, fitted, objective, 1.0, ALONE)
    assert all(s.p >= NAMING_LEVEL for s in found.scores)


def test_a_side_that_cannot_be_simulated_is_told_and_the_other_is_looked_at() -> None:
    scores, fitted, objective = examined(-TRUTH, Brittle)
    told: list[str] = []
    found = look_from_afar(scores, fitted, objective, 1.0, Crew(1, 1, told.append))
    assert told[0] == "  a1 = 0.3 cannot be simulated (no solution)"
    assert _of(found.scores, "non_schmid").p < NAMING_LEVEL
