from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import cast

import pytest

from driver.diagnosis.search import baseline as baseline_module
from driver.diagnosis.search.baseline import Prepared, loads_taken_back, prepared
from driver.diagnosis.search.boundary_noise import BoundaryNoiseSensitivities
from driver.diagnosis.search.refit import TOLERANCE
from driver.diagnosis.statistics.goodness_of_fit import FAMILY_LEVEL
from driver.diagnosis.statistics.screening import screened
from driver.identification.boundary_jitter import BoundaryJitter
from driver.identification.fit import Fit
from driver.identification.line_search import newton
from driver.identification.objective import Evaluation, Objective
from tools import closed_form
from tools.closed_form_diagnosis import SETTINGS, identified

BENCH = closed_form.problem()
WRONG, OFF = 12, 40 * closed_form.LOAD_NOISE


@cache
def baseline(off: float) -> tuple[Objective, Fit, Evaluation]:
    """The fit of an experiment of which one load is off [µN], every cause evaluated there."""
    made = closed_form.objective(BENCH, BENCH.truth)
    load = made.data.load.copy()
    load[WRONG] += off
    objective, fitted = identified(BENCH, replace(made, data=replace(made.data, load=load)))
    _, names = screened(objective.model, fitted.best.free, None)
    return objective, fitted, objective.evaluate(fitted.values, names)


def begin(off: float = 0.0, stated: float = 1.0, free_chi: float = 1.0) -> Prepared:
    """What screening begins with.

    Args:
        off: by how much one load is off [µN].
        stated: noise of the loads as stated over what they have.
        free_chi: χ of free correlation.
    """
    objective, fitted, augmented = baseline(off)
    causes, _ = screened(objective.model, fitted.best.free, None)
    data = replace(objective.data, load_noise=stated * objective.data.load_noise)
    objective = replace(objective, data=data)
    augmented = objective.compare(augmented.prediction, augmented.values, augmented.free)
    fitted = replace(fitted, best=objective.restrict(augmented, fitted.best.free))
    settings = replace(SETTINGS, free_chi=free_chi)
    return prepared(fitted, objective, augmented, causes, settings)


def test_a_baseline_that_is_near_enough_keeps_the_sensitivities_that_are_known() -> None:
    found = begin()
    assert found.bad == () and found.baseline.values == baseline(0.0)[1].values
    assert found.augmented is not None and found.augmented.free == baseline(0.0)[2].free
    residual = found.baseline.best.residual
    assert found.augmented.residual[: residual.size] == pytest.approx(residual, abs=1e-9)


def test_a_load_that_is_wrong_alone_is_left_out_of_the_fit_that_is_examined() -> None:
    found = begin(OFF)
    (bad,) = found.bad
    assert bad.frame == WRONG and bad.off == pytest.approx(OFF, rel=0.15)
    assert found.objective.data.bad_loads == (WRONG,) and found.augmented is None
    clean = baseline(0.0)[1].values
    moved, bent = (
        abs(values["tau0"] - clean["tau0"])
        for values in (found.baseline.values, baseline(OFF)[1].values)
    )
    assert moved < 0.25 * bent


@pytest.mark.parametrize("stated", [0.5, 2.0])
def test_the_noise_of_the_loads_is_that_of_their_fast_residual(stated: float) -> None:
    data = begin(stated=stated).objective.data
    assert data.load_noise == pytest.approx(closed_form.LOAD_NOISE, rel=0.35)
    assert 5 < data.load_degrees < len(data.load)


def test_images_that_free_correlation_cannot_follow_count_by_what_it_leaves() -> None:
    assert begin(free_chi=5.0).objective.data.image.noise_factor == 5.0
    assert begin().objective.data.image.noise_factor < 1.2


def test_without_the_answers_to_a_noise_of_the_boundary_no_load_is_taken_back() -> None:
    found = begin(OFF)
    assert loads_taken_back(found, BoundaryNoiseSensitivities(None, None), (), ()) is found


@pytest.mark.parametrize("seen", [True, False])
def test_loads_are_taken_back_where_the_noise_that_explains_them_is_seen_with_any_cause_free(
    monkeypatch: pytest.MonkeyPatch, seen: bool
) -> None:
    found, p = begin(OFF), (0.5 if seen else 1.0) * FAMILY_LEVEL
    stops = BoundaryNoiseSensitivities(cast(BoundaryJitter, SimpleNamespace()))
    monkeypatch.setattr(baseline_module, "explains_better", lambda *_: True)
    monkeypatch.setattr(baseline_module, "score_boundary_noise", lambda *_: SimpleNamespace(p=p))
    after = loads_taken_back(found, stops, (), found.baseline.best.free)
    assert (after is found) != seen
    assert after.objective.data.bad_loads == (() if seen else (WRONG,))
    assert len(after.bad) == (0 if seen else 1)


def test_what_is_prepared_is_fitted_to_first_order() -> None:
    found = begin(OFF)
    assert newton(found.objective, found.baseline.best)[1] < TOLERANCE
