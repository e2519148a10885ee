from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from driver.diagnosis.answer.result_types import Diagnosis
from driver.diagnosis.statistics.screening import honoured, parameters_of_the_specimen
from driver.forward.dwell_time import dwells, dwells_tangent, stretch_dwells
from driver.parameters.history import HOLD
from meshes.arrays import FloatArray
from solver_adapters.interface import Capabilities, Simulation
from tools import closed_form
from tools.closed_form_diagnosis import diagnosis_of, identified

BENCH = closed_form.problem()
RECALLED = closed_form.time_signals
TIMES = np.array([0.0, 10, 20, 26, 30, 45, 50, 60])
STILL = np.array([False, True, True, False, False, True, False])


def relaxing(simulation: Simulation) -> tuple[dict[str, FloatArray], FloatArray]:
    """The closed form, whose load falls with the logarithm of the time that the stage stands."""
    signals, load = RECALLED(simulation)
    still = np.abs(np.diff(simulation.motion, axis=0)).max(axis=(1, 2)) < 1e-12
    held = np.zeros(len(simulation.times))
    for k, length in enumerate(np.diff(simulation.times)):
        held[k + 1] = held[k] + length if still[k] else 0.0
    return signals, load * (1 - 0.1 * np.log1p(held[simulation.output] / 3.0))


@pytest.fixture(autouse=True)
def specimen_that_relaxes(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(closed_form, "time_signals", relaxing)
    yield


@cache
def diagnosed(error: float) -> Diagnosis:
    made = closed_form.objective(BENCH, BENCH.truth | {HOLD: error})
    return diagnosis_of(BENCH, identified(BENCH, made))


def test_each_hold_is_longer_and_all_that_follows_later() -> None:
    longer = stretch_dwells(TIMES, STILL, 4.0)
    # 10 to 26 s is one hold of two intervals, 30 to 45 none, 45 to 50 another.
    np.testing.assert_allclose(longer, [0, 10, 22.5, 30, 34, 49, 58, 68])
    assert stretch_dwells(TIMES, STILL, 0.0) is TIMES
    assert np.all(np.diff(stretch_dwells(TIMES, STILL, -600.0)) > 0)
    no_hold = np.zeros(7, dtype=bool)
    np.testing.assert_allclose(stretch_dwells(TIMES, no_hold, 9.0), TIMES)


@pytest.mark.parametrize("error", [0.0, 4.0, -3.0, -10.0, -600.0])
def test_the_tangent_of_the_clock_is_its_difference_quotient(error: float) -> None:
    """Of holds of 16 and 5 s; −10 s cuts the short one to its twentieth, −600 s both."""
    high, low = (stretch_dwells(TIMES, STILL, error + h) for h in (1e-3, -1e-3))
    tangent = dwells_tangent(TIMES, STILL, error)
    np.testing.assert_allclose(tangent, (high - low) / 2e-3, atol=1e-10)
    assert tangent[-1] == pytest.approx({-10.0: 1.0, -600.0: 0.0}.get(error, 2.0), abs=1e-14)


def test_a_history_without_holds_has_no_tangent() -> None:
    assert not dwells_tangent(TIMES, np.zeros(7, dtype=bool), 9.0).any()


def test_a_hold_is_where_no_knot_gains_weight() -> None:
    weights = np.array([[1.0, 0], [0.5, 0.5], [0.5, 0.5], [0, 1]])
    assert dwells(weights).tolist() == [False, True, False]
    still = dwells(BENCH.model.boundary.weights)
    assert np.count_nonzero(still) == 4  # two at each peak
    assert HOLD in parameters_of_the_specimen(BENCH.model)


def test_a_solver_that_does_not_answer_along_the_instants_is_not_asked_for_the_holds() -> None:
    class Timeless(closed_form.ClosedFormSolver):
        def capabilities(self) -> Capabilities:
            return replace(super().capabilities(), times=False)

    model = BENCH.model
    assert HOLD in honoured(model)
    assert HOLD not in honoured(replace(model, adapter=Timeless()))


def test_the_derivative_is_that_of_two_simulations_and_others_stay_in_place() -> None:
    free = ("tau0", HOLD, "c")
    found = BENCH.model.predict(BENCH.truth, free)
    plain = BENCH.model.predict(BENCH.truth, ("tau0", "c"))
    np.testing.assert_array_equal(found.d_load[[0, 2]], plain.d_load)
    np.testing.assert_array_equal(found.d_surface[[0, 2]], plain.d_surface)
    above, below = (
        BENCH.model.predict(BENCH.truth | {HOLD: error}).load for error in (0.01, -0.01)
    )
    slope = (above - below) / 0.02
    np.testing.assert_allclose(found.d_load[1], slope, atol=1e-6 * np.abs(slope).max())
    alone = BENCH.model.predict(BENCH.truth, (HOLD,))
    np.testing.assert_array_equal(alone.d_load[0], found.d_load[1])


def test_a_hidden_error_of_the_holds_is_named_and_its_size_found() -> None:
    found = diagnosed(30.0)
    assert found.verdict.kind == "named" and found.verdict.names == ("hold_time",)
    sigma = found.extended.sigma(HOLD, found.objective.parameters)
    assert abs(found.extended.values[HOLD] - 30.0) < 3.5 * sigma < 15.0
    assert found.extended.best.chi_load < found.baseline.best.chi_load


def test_holds_as_stamped_are_not_named() -> None:
    found = diagnosed(0.0)
    assert found.verdict.kind == "nothing wrong"
    (scored,) = (s for s in found.rounds[0].scores if s.cause.name == "hold_time")
    assert scored.p > 0.05 and np.isfinite(scored.visible).all()
