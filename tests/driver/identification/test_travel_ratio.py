from __future__ import annotations

import numpy as np
import pytest

from driver.experiment.history import knot_weights
from driver.identification.fit import Fit
from driver.identification.travel_ratio import TravelRatio, travel_ratio
from driver.parameters.boundary import elongation_names
from driver.parameters.registry import declared_parameters
from tests.driver.analytic import evaluation
from tools import closed_form

HISTORY = closed_form.problem().history
NAMES = elongation_names(HISTORY.n_knots)
PARAMETERS = declared_parameters(HISTORY.n_knots)
KNOTS = np.array([0.030, 0.026, 0.061, 0.055])


def fitted(free: tuple[str, ...] = NAMES) -> Fit:
    jacobian = np.random.default_rng(3).standard_normal((len(free), 40))
    values = dict(zip(NAMES, KNOTS, strict=True))
    return Fit(evaluation(np.zeros(40), jacobian, free=free, values=values), True, "", ())


def test_the_ratio_is_the_slope_of_the_elongation_of_the_ends_over_stage_travel() -> None:
    found = travel_ratio(fitted(), PARAMETERS, HISTORY)
    assert found is not None
    rows = HISTORY.image_row
    weights = knot_weights(HISTORY)[rows]
    assert found.value == pytest.approx(
        np.polyfit(HISTORY.stage[rows], weights @ [0.0, *KNOTS], 1)[0]
    )
    steps = np.diff([0.0, *KNOTS]) / np.diff(HISTORY.stage[HISTORY.turning])
    assert found.of_phases == pytest.approx(np.sqrt(np.mean((steps - found.value) ** 2)))


def test_its_deviation_is_the_scatter_by_that_of_the_knots() -> None:
    fit, rng = fitted(), np.random.default_rng(4)
    found = travel_ratio(fit, PARAMETERS, HISTORY)
    scale = np.array([PARAMETERS[name].scale for name in NAMES])
    draws = KNOTS + scale * rng.multivariate_normal(np.zeros(4), fit.covariance, 20_000)
    rows = HISTORY.image_row
    lines = draws @ knot_weights(HISTORY)[rows, 1:].T
    slopes = np.polyfit(HISTORY.stage[rows], lines.T, 1)[0]
    # 20 000 draws know a deviation to half a percent.
    assert found is not None and found.sigma == pytest.approx(slopes.std(), rel=0.025)


def test_a_knot_that_is_held_tells_no_ratio() -> None:
    assert travel_ratio(fitted(NAMES[1:]), PARAMETERS, HISTORY) is None


def test_it_is_told_with_the_keys_that_it_serves() -> None:
    told = TravelRatio(6.14e-4, 0.05e-4, 1.9e-4).sentence()
    assert "the elongation is (6.14 ± 0.05)·10⁻⁴ of the stage travel" in told
    assert "1.9·10⁻⁴ off" in told and "stage_ratio and stage_ratio_uncertainty" in told
