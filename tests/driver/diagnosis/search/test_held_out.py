from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from driver.diagnosis.answer.result_types import HeldOut
from driver.diagnosis.search import held_out
from driver.diagnosis.search.held_out import (
    HeldOutTask,
    knots_of_cycle,
    predict_held_out,
    trained_on_others,
)
from driver.experiment.history import knot_weights
from driver.identification.fit import Fit, fit
from driver.identification.objective import Evaluation
from driver.parameters.boundary import elongation_names, tilt_names
from tools import closed_form

NAMES = (*elongation_names(5), *tilt_names(5))


def test_knots_are_of_a_cycle_if_they_move_no_other() -> None:
    history = closed_form.history()
    weights = knot_weights(history)
    # Knot 2 ends the first cycle and begins the second.
    assert knots_of_cycle(history.cycle, weights, 2, NAMES) == (
        "elongation_3", "elongation_4", "tilt_3", "tilt_4",
    )  # fmt: skip
    assert knots_of_cycle(history.cycle, weights, 1, NAMES) == ("elongation_1", "tilt_1")
    only_elongation = knots_of_cycle(history.cycle, weights, 2, NAMES[:4])
    assert only_elongation == ("elongation_3", "elongation_4")


def task(drift: float, stiff: float) -> HeldOutTask:
    """Cycle 2 from cycle 1, with a wrong stiffness in the model and a drift in the loads."""
    b = closed_form.problem()
    truth = b.truth | {"elastic_scale": stiff}
    objective = closed_form.objective(b, truth, seed=3)
    load = objective.data.load + drift * (b.history.cycle == 2)
    objective = replace(objective, data=replace(objective.data, load=load))
    free = ("tau0", *NAMES)
    start = fit(objective, b.truth, free, 5)
    knots = knots_of_cycle(b.history.cycle, knot_weights(b.history), 2, NAMES)
    return HeldOutTask(objective, start, 2, b.history.cycle, knots)


def predicted(drift: float, stiff: float) -> HeldOut:
    return predict_held_out(task(drift, stiff))


def test_a_right_model_predicts_a_cycle_that_it_has_not_seen() -> None:
    found = predicted(drift=0.0, stiff=1.0)
    assert found.cycle == 2
    assert found.chi_load == pytest.approx(1.0, abs=0.3)
    assert found.chi_image == pytest.approx(1.0, abs=0.1)


def test_a_wrong_model_does_not() -> None:
    assert predicted(drift=0.0, stiff=1.3).chi_load > 1.7


def test_a_load_that_is_wrong_in_that_cycle_alone_is_seen_there() -> None:
    assert predicted(drift=30.0, stiff=1.0).chi_load > 2.5


def test_the_held_out_loads_teach_nothing() -> None:
    """What is fitted to the other cycles is the same whatever the loads of the held-out one."""
    right, wrong = task(0.0, 1.0), task(30.0, 1.0)
    sigma = right.fit.sigma("tau0", right.objective.parameters)
    whole = [one.fit.values["tau0"] for one in (right, wrong)]
    others = [trained_on_others(one).values["tau0"] for one in (right, wrong)]
    assert abs(whole[1] - whole[0]) > 5 * sigma  # to all cycles it is another fit
    assert abs(others[1] - others[0]) < 0.5 * sigma


def test_knots_that_the_held_out_loads_show_are_counted_as_fitted_to_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Those of the elongation, of which two are of the second cycle alone."""
    ends: list[Evaluation] = []

    def noted(*given: Any, **more: Any) -> Fit:
        ends.append((found := fit(*given, **more)).best)
        return found

    monkeypatch.setattr(held_out, "fit", noted)
    found = predicted(drift=30.0, stiff=1.0)
    loads = ends[-1].residual[: ends[-1].n_load]
    assert loads.size == np.sum(closed_form.history().cycle == 2)
    assert found.chi_load == pytest.approx(float(np.sqrt(loads @ loads / (loads.size - 2))))


def test_a_held_out_middle_makes_no_neighbours_of_the_frames_around_it() -> None:
    """Whitened unit loads of the frames around the gap, AR(1) noise of 0.8 a frame."""
    b = closed_form.problem()
    data = replace(closed_form.objective(b, b.truth).data, autocorrelation=0.8)
    frames = np.concatenate([np.arange(10), np.arange(20, 30)])
    around = data.frames(frames)
    root = around.load_changes(np.eye(20))[:, :20].T * around.load_noise
    noise = 0.8 ** np.abs(frames[:, None] - frames[None])
    np.testing.assert_allclose(root @ noise @ root.T, np.eye(20), atol=1e-12)
