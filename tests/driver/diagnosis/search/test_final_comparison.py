from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from driver.diagnosis.causes.causes import LIBRARY, Cause
from driver.diagnosis.causes.noise_causes import BOUNDARY_NOISE
from driver.diagnosis.search.final_comparison import Final, correction_at, final_comparison
from driver.identification.boundary_jitter import boundary_jitter
from driver.identification.correction import Correction, SecondMesh
from driver.identification.fit import Fit, fit
from driver.identification.objective import Objective
from meshes.arrays import FloatArray
from solver_adapters.interface import Simulation
from tools import closed_form
from tools.closed_form_diagnosis import SETTINGS, finer, identified

BENCH = closed_form.problem()
(CURVED,) = (cause for cause in LIBRARY if cause.name == "stretch_not_proportional")
HELD_OUT = replace(SETTINGS, held_out=2)


@cache
def baseline() -> tuple[Fit, Objective]:
    objective, fitted = identified(
        BENCH, closed_form.objective(BENCH, BENCH.truth | {"stretch_curvature": 0.1})
    )
    return fitted, objective


@cache
def extended() -> tuple[Fit, Objective]:
    """With the curved stretch, and loads twice as noisy as the baseline was told."""
    here, objective = baseline()
    data = replace(objective.data, load_noise=2 * objective.data.load_noise)
    louder = replace(objective, data=data)
    free = (*here.best.free, *CURVED.parameters)
    return fit(louder, here.values, free, 12), louder


class Failing(closed_form.ClosedFormSolver):
    """A finer simulation that must not be run."""

    def answer(self, simulation: Simulation) -> tuple[FloatArray, FloatArray]:
        raise AssertionError("simulated again")


FAILING = replace(BENCH.model, adapter=Failing())


def ends(last: tuple[Fit, Objective], *causes: Cause) -> Final:
    return final_comparison(baseline(), last, causes, finer(BENCH), BENCH.history.cycle, HELD_OUT)


def test_before_and_after_are_compared_under_the_covariance_of_the_end() -> None:
    here, objective = baseline()
    found = ends(extended(), CURVED)
    again = fit(extended()[1], here.values, here.best.free, 12)
    assert found.before.cost == pytest.approx(again.best.cost, rel=1e-3)
    assert found.before.cost < 0.95 * here.best.cost  # twice the noise, fewer σ²
    assert found.uncounted is found.before


def test_without_a_cause_the_fit_itself_is_before_and_after() -> None:
    here, _ = baseline()
    found = ends(baseline())
    assert found.before is here.best and found.uncounted is here.best
    assert found.held_out is not None and found.held_out[0] == found.held_out[1]


def test_the_correction_is_taken_anew_at_the_end() -> None:
    here, objective = extended()
    found = ends((here, objective), CURVED)
    fine, coarse = (m.predict(here.values) for m in (finer(BENCH), BENCH.model))
    assert found.fresh.load == pytest.approx(fine.load - coarse.load, abs=1e-9)
    assert not np.allclose(found.fresh.load, objective.correction.load, rtol=1e-3)
    alone = correction_at(here, objective, finer(BENCH))
    assert np.array_equal(alone.load, found.fresh.load)
    known = final_comparison(
        baseline(), (here, objective), (CURVED,), FAILING, BENCH.history.cycle, HELD_OUT, alone
    )
    assert known.fresh is alone and known.before.cost == found.before.cost
    assert known.held_out == found.held_out


def test_what_a_noise_of_the_boundary_explains_is_an_excess_where_it_is_not_counted() -> None:
    here, objective = baseline()
    jitter = boundary_jitter(objective.model, objective.data.image, here.values, 1e-3)
    noisy = replace(objective, data=replace(objective.data, jitter=jitter))
    last = fit(noisy, here.values, here.best.free, 12)
    found = ends((last, noisy), BOUNDARY_NOISE)
    assert found.uncounted.cost > found.before.cost + 10
    assert found.uncounted.cost == pytest.approx(here.best.cost, rel=1e-3)


def test_the_cycle_that_was_held_out_is_predicted_better_by_what_happened() -> None:
    found = ends(extended(), CURVED)
    assert found.held_out is not None
    before, after = found.held_out
    assert before.cycle == after.cycle == 2 and after.chi_load < 0.8 * before.chi_load


def test_what_a_second_mesh_adds_counts_at_the_end_and_in_the_model_before() -> None:
    """Where it was asked for in a later round, the baseline had the first mesh alone."""
    here, objective = baseline()
    fitted, current = extended()
    motion, load = np.asarray(objective.correction.motion), np.asarray(objective.correction.load)
    added = Correction(np.zeros_like(motion), np.full_like(load, 3.0))
    second = SecondMesh(added, 0.667)
    both = replace(current, correction=current.correction.with_second(second), second=second)
    found = ends((fitted, both), CURVED)
    alone = ends((fitted, current), CURVED)
    np.testing.assert_allclose(found.fresh.load, np.asarray(alone.fresh.load) + 3.0)
    there = replace(objective, data=both.data, correction=objective.correction.with_second(second))
    assert found.before.cost == pytest.approx(
        fit(there, here.values, here.best.free, 12).best.cost, rel=1e-6
    )
    assert found.before.cost != pytest.approx(alone.before.cost, rel=1e-6)
