from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from driver.forward.load_lag import load_at
from driver.identification.fit import fit
from driver.parameters.boundary import LAMBDAS, elongation_names, tilt_names
from driver.parameters.instrument import LARGEST_LAG
from tools import closed_form
from tools.closed_form import KNOTS, LAW
from tools.closed_form_diagnosis import priors

# A move of 10 s, a hold of 30 s in which the load relaxes by 6 µN, and the next move.
TIMES = np.array([0.0, 10.0, 40.0, 50.0])
FORCE = np.array([0.0, 56.0, 50.0, 105.0])


def test_in_the_rows_the_force_is_not_touched() -> None:
    np.testing.assert_array_equal(load_at(TIMES, FORCE, TIMES)[0], FORCE)


def test_between_the_rows_the_force_is_linear_in_time() -> None:
    at = np.array([-5.0, 4.0, 25.0, 38.0, 43.0, 60.0])
    force, rate = load_at(TIMES, FORCE, at)
    np.testing.assert_allclose(force, [0.0, 22.4, 53.0, 50.4, 66.5, 105.0], rtol=1e-12)
    np.testing.assert_allclose(rate, [0.0, 5.6, -0.2, -0.2, 5.5, 0.0], atol=1e-12)


def test_at_the_end_of_a_hold_the_rate_is_the_mean_of_both_sides() -> None:
    _, rate = load_at(TIMES, FORCE, np.array([40.0]))
    assert rate[0] == pytest.approx((5.5 - 0.2) / 2)


def test_the_rate_is_that_of_the_force_also_where_it_bends() -> None:
    at, h = np.linspace(-1.0, 51.0, 521) + 0.013, 1e-5
    difference = (load_at(TIMES, FORCE, at + h)[0] - load_at(TIMES, FORCE, at - h)[0]) / (2 * h)
    np.testing.assert_allclose(load_at(TIMES, FORCE, at)[1], difference, atol=1e-6)
    # Without a jump: a fit can pass from one side to the other.
    assert np.abs(np.diff(load_at(TIMES, FORCE, np.linspace(39, 41, 2001))[1])).max() < 0.05


def test_each_derivative_is_read_like_the_force() -> None:
    d_force = np.stack([2.0 * FORCE, FORCE**2])
    at = np.array([12.0, 41.0])
    both = load_at(TIMES, d_force, at)[0]
    for one, of_both in zip(d_force, both, strict=True):
        np.testing.assert_array_equal(load_at(TIMES, one, at)[0], of_both)


@pytest.mark.parametrize("lag", [-LARGEST_LAG, LARGEST_LAG])
def test_the_largest_lag_can_be_read_from_the_first_to_the_last_row(lag: float) -> None:
    force, rate = load_at(TIMES, FORCE, TIMES[[0, -1]] + lag)
    expected = FORCE[0] if lag < 0 else FORCE[-1]
    assert force[0 if lag < 0 else -1] == expected and rate[0 if lag < 0 else -1] == 0.0


def test_rows_closer_than_a_second_are_read_as_well() -> None:
    times = np.array([0.0, 0.2, 0.4, 10.0])
    force, _ = load_at(times, FORCE, np.array([0.1, 0.3]))
    np.testing.assert_allclose(force, [28.0, 53.0], rtol=1e-12)


@pytest.mark.parametrize(("lag", "seed"), [(2.0, 0), (-2.0, 1), (0.0, 2), (0.0, 3)])
def test_a_fit_finds_the_lag_from_none_with_the_knots_free(lag: float, seed: int) -> None:
    """Images and loads of the closed-form specimen; the start is where the force bends."""
    problem = closed_form.problem()
    made = closed_form.objective(problem, problem.truth | {"load_lag": lag}, seed)
    prior = priors(problem.truth) | {"load_lag": (0.0, 1.0)}
    n = len(KNOTS) + 1
    free = (*LAMBDAS, *elongation_names(n), *tilt_names(n), *LAW, "load_lag")
    found = fit(replace(made, prior=prior), problem.truth, free, 15)
    assert found.converged
    sigma = found.sigma("load_lag", made.parameters)
    assert abs(found.values["load_lag"] - lag) < 3 * sigma
    assert sigma < 0.5
    assert found.best.chi_load == pytest.approx(1.0, abs=0.35)
