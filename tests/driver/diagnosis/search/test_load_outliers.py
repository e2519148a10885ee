from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy.stats import kstest

from driver.diagnosis.search.load_outliers import bad_loads, load_noise
from driver.identification.data import Data
from driver.identification.objective import Evaluation
from meshes.arrays import FloatArray
from tests.driver.analytic import evaluation

T = 60
CLOCK = np.linspace(0, 1, T)
KNOTS = np.maximum(0, 1 - 6 * np.abs(CLOCK[None] - np.linspace(0, 1, 7)[1:, None]))
J = np.concatenate([20 * KNOTS, [np.sin(np.pi * (k + 0.5) * CLOCK) for k in range(5)]])
WEIGHT = 0.01  # of the law: 10 σ of a load


def data(autocorrelation: float = 0.0, noise: float = 1.0) -> Data:
    """Loads alone: no number of the images is looked at."""
    images = cast(Any, SimpleNamespace(n_z=0, noise_factor=1.0))
    return Data(images, np.zeros(T), noise, autocorrelation, np.arange(T))


DATA = data()


def fitted(load: FloatArray, rows: FloatArray = J, held: float = 1e-6) -> Evaluation:
    """What a fit leaves of a whitened load: the law within a prior, knots held by the images."""
    prior = np.repeat([held, WEIGHT], [6, 5])
    solved = np.linalg.solve(rows @ rows.T + np.diag(prior), rows @ load)
    theta = np.asarray(solved, dtype=np.float64)
    return evaluation(load - theta @ rows, rows, prior, -theta, n_load=T)


@cache
def noise(seed: int) -> FloatArray:
    return np.random.default_rng(seed).standard_normal(T)


def test_no_load_is_wrong_in_99_of_100_nulls_whatever_the_noise() -> None:
    found = [bad_loads(fitted(2.2 * noise(seed)), DATA) for seed in range(1000)]
    # 1 % of 1000 are 10, with a standard deviation of 3
    assert sum(bool(bad) for bad in found) < 20


@pytest.mark.parametrize("frame", [1, 9, 10, 33, T - 3])
@pytest.mark.parametrize("autocorrelation", [0.0, 0.5])
def test_a_load_of_40_sigma_is_found_with_its_error(frame: int, autocorrelation: float) -> None:
    own = data(autocorrelation)
    wrong = own.load_changes(np.eye(T))[frame]
    (bad,) = bad_loads(fitted(noise(frame) + 40 * wrong), own)
    assert bad.frame == frame and abs(bad.sigmas) > 10
    assert abs(bad.off - 40) < 4 * bad.off / bad.sigmas


def test_loads_side_by_side_do_not_hide_one_another() -> None:
    load = noise(3) + 40 * np.eye(T)[20] - 30 * np.eye(T)[21] + 15 * np.eye(T)[50]
    assert [bad.frame for bad in bad_loads(fitted(load), DATA)] == [20, 21, 50]


def test_a_slow_model_error_is_no_bad_load_and_hides_none() -> None:
    slow = 50 * np.cos(9 * np.pi * CLOCK)
    assert bad_loads(fitted(noise(4) + slow), DATA) == ()
    (bad,) = bad_loads(fitted(noise(4) + slow + 40 * np.eye(T)[25]), DATA)
    assert bad.frame == 25


def test_what_a_cause_does_to_a_single_load_is_left_to_the_cause() -> None:
    """An offset shows most in the loads before the knots are felt."""
    jump = np.eye(T)[1]
    at = fitted(noise(5) + 40 * jump)
    assert [bad.frame for bad in bad_loads(at, DATA)] == [1]
    assert bad_loads(at, DATA, [20 * jump[None], np.sin(CLOCK)[None]]) == ()
    assert [bad.frame for bad in bad_loads(at, DATA, [np.sin(CLOCK)[None]])] == [1]


def test_where_many_loads_are_wrong_none_is_an_outlier() -> None:
    load = noise(6).copy()
    load[::6] += 40
    assert bad_loads(fitted(load), DATA) == ()


@pytest.mark.parametrize(("wrong", "found"), [([10, 33, 50], True), ([10, 20, 33, 50], False)])
def test_no_more_than_a_twentieth_of_the_loads_are_outliers(wrong: list[int], found: bool) -> None:
    load = noise(6) + 40 * np.isin(np.arange(T), wrong)
    assert [bad.frame for bad in bad_loads(fitted(load), DATA)] == (wrong if found else [])


def test_the_noise_of_the_loads_is_estimated_without_bias_and_with_its_degrees() -> None:
    """Of loads that parameters of the law have moved as their prior says."""
    rng = np.random.default_rng(7)
    powers = []
    for seed in range(400):
        moved = rng.standard_normal(5) / np.sqrt(WEIGHT) @ J[6:]
        factor, degrees = load_noise(fitted(noise(seed) + moved), DATA)
        powers.append(factor**2 * degrees)
    assert T / 3 < degrees <= T / 2
    assert kstest(powers, "chi2", args=(degrees,)).pvalue > 0.01


def test_a_slow_model_error_is_not_taken_for_noise() -> None:
    slow = 10 * np.cos(9 * np.pi * CLOCK)
    factor, _ = load_noise(fitted(noise(8) + slow), DATA)
    quiet, _ = load_noise(fitted(noise(8)), DATA)
    assert factor == pytest.approx(quiet, rel=0.05)


def test_a_model_error_where_knots_move_the_loads_is_not_taken_for_noise() -> None:
    """The images hold the knots as firmly as the loads do, and contradict them."""
    jumps = np.concatenate([J[:6] * (-1.0) ** np.arange(T), J[6:]])
    held = float(np.sum(jumps[0] ** 2))
    wrong = 0.3 * np.ones(6) @ jumps[:6]
    factor, degrees = load_noise(fitted(noise(8) + wrong, jumps, held), DATA)
    quiet, _ = load_noise(fitted(noise(8), jumps, held), DATA)
    assert factor == pytest.approx(quiet, rel=0.05) and degrees > T / 3


def test_noise_of_the_boundary_leaves_that_of_the_loads_as_stated() -> None:
    jittery = replace(DATA, jitter=cast(Any, SimpleNamespace()))
    assert load_noise(fitted(3 * noise(9)), jittery) == (1.0, np.inf)


def test_of_few_loads_nothing_is_said() -> None:
    few = replace(DATA, index=np.arange(10))
    at = evaluation(np.ones(10), np.eye(2, 10), n_load=10)
    assert bad_loads(at, few) == () and load_noise(at, few) == (1.0, np.inf)
