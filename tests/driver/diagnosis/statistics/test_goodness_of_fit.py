from __future__ import annotations

from dataclasses import astuple
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy.stats import f, kstest

from driver.diagnosis.statistics.goodness_of_fit import GoodnessOfFit, _outlier, goodness_of_fit
from driver.identification.data import Data
from meshes.arrays import FloatArray
from tests.driver.analytic import evaluation

T, N_Z, K = 60, 12, 11
CLOCK = np.linspace(0, 1, T)


def jacobian() -> FloatArray:
    """Six knots that loads and images feel, and five smooth parameters of the law."""
    rng = np.random.default_rng(6)
    knots = np.maximum(0, 1 - 6 * np.abs(CLOCK[None] - np.linspace(0, 1, 7)[1:, None]))
    law = np.array([np.sin(np.pi * (k + 0.5) * CLOCK) for k in range(5)])
    in_time = np.concatenate([knots, law])
    images = in_time[:, :, None] * rng.standard_normal((K, 1, N_Z))
    return np.concatenate([20 * in_time, images.reshape(K, T * N_Z)], axis=1)


J = jacobian()
DATA = Data(cast(Any, SimpleNamespace(n_z=N_Z)), np.zeros(T), 1.0, 0.0, np.arange(T))


CAUSES = [np.random.default_rng(7).standard_normal((k, T * (1 + N_Z))) for k in (1, 1, 3, 2, 8)]
FIELDS = np.random.default_rng(8).standard_normal((9, T * (1 + N_Z)))
FIELDS[:, :T] = 0.0  # of the images alone
NO_SHAPES = np.zeros((0, 0))


def after_a_fit(load: FloatArray, images: FloatArray) -> GoodnessOfFit:
    """The tests of what a least-squares fit with J leaves."""
    data = np.concatenate([load, images.ravel()])
    rest = data - J.T @ np.linalg.solve(J @ J.T, J @ data)
    return goodness_of_fit(evaluation(rest, J, n_load=T), DATA, CAUSES, FIELDS, NO_SHAPES)


@pytest.fixture(scope="module")
def noise() -> list[GoodnessOfFit]:
    rng = np.random.default_rng(0)
    return [after_a_fit(rng.standard_normal(T), rng.standard_normal((T, N_Z))) for _ in range(1000)]


def test_noise_is_taken_for_noise_in_99_of_100_cases(noise: list[GoodnessOfFit]) -> None:
    # 1 % of 1000 are 10; so short a series has a few more
    assert sum(not found.accepted for found in noise) < 25


@pytest.mark.parametrize("name", ["load_slow", "image_slow", "together", "smooth"])
def test_what_the_fit_has_taken_is_counted(noise: list[GoodnessOfFit], name: str) -> None:
    p = np.array([getattr(found, name) for found in noise])
    assert kstest(p, "uniform").pvalue > 1e-3


def test_the_serial_test_does_not_cry_wolf_over_fitted_knots(noise: list[GoodnessOfFit]) -> None:
    p = np.array([found.load_serial for found in noise])
    assert np.mean(p < 0.01) < 0.02 and np.mean(p < 0.1) == pytest.approx(0.1, abs=0.02)


def test_an_error_of_the_noise_level_changes_nothing() -> None:
    rng = np.random.default_rng(1)
    load, images = rng.standard_normal(T), rng.standard_normal((T, N_Z))
    right, loud = after_a_fit(load, images), after_a_fit(1.1 * load, 1.1 * images)
    np.testing.assert_allclose(astuple(right), astuple(loud), rtol=1e-9)
    assert right.accepted


def test_a_slow_error_is_seen_in_its_own_signal() -> None:
    rng = np.random.default_rng(12)
    slow = np.sin(7 * np.pi * CLOCK)  # between the knots
    load, images = rng.standard_normal(T), rng.standard_normal((T, N_Z))
    in_load = after_a_fit(load + 3 * slow, images)
    assert not in_load.accepted and in_load.load_slow < 1e-3 and in_load.image_slow > 0.01
    in_images = after_a_fit(load, images + 1.5 * slow[:, None] * np.ones(N_Z))
    assert not in_images.accepted and in_images.image_slow < 1e-6 and in_images.load_slow > 0.01


def test_serial_correlation_of_the_load_is_seen() -> None:
    rng = np.random.default_rng(3)
    rejected = 0
    for _ in range(100):
        load = np.zeros(T)
        load[0], steps = rng.standard_normal(), rng.standard_normal(T)
        for t in range(1, T):
            load[t] = 0.7 * load[t - 1] + np.sqrt(1 - 0.7**2) * steps[t]
        found = after_a_fit(load, rng.standard_normal((T, N_Z)))
        rejected += not found.accepted
    assert rejected > 40


def test_the_test_of_single_images_keeps_its_level(noise: list[GoodnessOfFit]) -> None:
    """That of T images together: a Bonferroni bound, a little below it."""
    p = np.array([found.image_outlier for found in noise])
    # 50 of 1000, with a standard deviation of 7
    assert 25 < np.sum(p < 0.05) < 71


def f_test(images: FloatArray) -> float:
    """Of the power of the image that stands out most, times their number."""
    power, number, n = np.sum(images**2, axis=1), *images.shape
    others = (power.sum() - power) / (number - 1)
    return min(1.0, float(number * f.sf(power / others, n, (number - 1) * n).min()))


def outliers(number: int, pixels: int, differ: float, wrong: float = 1.0) -> FloatArray:
    """p of 1000 series, ours and by an F test, shape (1000, 2); the fourth image has more noise."""
    rng = np.random.default_rng(16)
    found = []
    for _ in range(1000):
        levels = np.exp(differ * rng.standard_normal((number, 1)))
        levels[3] *= wrong
        images = levels * rng.standard_normal((number, pixels))
        found.append((_outlier(images, np.zeros((1, *images.shape))), f_test(images)))
    return np.array(found)


@pytest.mark.parametrize(
    ("number", "differ", "share"), [(21, 0.05, 0.6), (60, 0.05, 0.6), (60, 0.1, 0.25)]
)
def test_images_whose_levels_differ_a_little_stand_out_more_seldom_than_by_an_f_test(
    number: int, differ: float, share: float
) -> None:
    # Quantiles of so few images have an error of their own, by which it is not 1 %.
    ours, others = np.mean(outliers(number, 77, differ) < 0.01, axis=0)
    assert others > 0.06 and ours < share * others


def test_even_images_stand_out_no_more_than_by_an_f_test_and_mostly_as_much() -> None:
    ours, others = outliers(21, 77, 0.0).T
    assert np.all(ours > 0.95 * others)
    assert np.mean(ours < 1.05 * others) > 0.6


def test_an_image_with_two_fifths_more_noise_is_seen_in_three_of_four_series() -> None:
    """Of 21 images of 77 pixels each; by an F test, in five of six."""
    ours, others = np.mean(outliers(21, 77, 0.0, 1.4) < 0.01, axis=0)
    assert ours == pytest.approx(0.75, abs=0.05) and others == pytest.approx(0.84, abs=0.05)


@pytest.mark.parametrize(("number", "wrong"), [(T, [5, 20, 40]), (21, [3, 9, 15])])
def test_three_images_that_are_wrong_do_not_hide_one_another(number: int, wrong: list[int]) -> None:
    rng = np.random.default_rng(17)
    images = rng.standard_normal((number, N_Z))
    images[wrong] *= 4
    assert _outlier(images, np.zeros((1, *images.shape))) < 1e-6


def test_what_no_cause_describes_alone_is_seen_where_all_together_do() -> None:
    """6 σ along a sum of all causes: none of them takes more than a third of its power."""
    rng = np.random.default_rng(14)
    along = np.concatenate([row / np.linalg.norm(row) for rows in CAUSES for row in rows])
    along = along.reshape(15, -1).sum(axis=0)
    effect = 7.0 * along / np.linalg.norm(along)
    load, images = rng.standard_normal(T), rng.standard_normal((T, N_Z))
    found = after_a_fit(load + effect[:T], images + effect[T:].reshape(T, N_Z))
    assert not found.accepted and found.together < 1e-3 and found.image_slow > 0.01
    assert 20 < found.left < 80
    without = after_a_fit(load, images)
    assert without.accepted and without.left < 20


def test_what_is_like_no_cause_is_seen_where_it_is_smooth() -> None:
    """7 σ along a sum of nine fields, a share of 1 in 80 of the power of noise."""
    rng = np.random.default_rng(15)
    along = FIELDS.sum(axis=0)
    effect = 7.0 * along / np.linalg.norm(along)
    load, images = rng.standard_normal(T), rng.standard_normal((T, N_Z))
    found = after_a_fit(load, images + effect[T:].reshape(T, N_Z))
    assert not found.accepted and found.smooth < 1e-3
    assert min(found.image_slow, found.together) > 0.01
    assert 20 < found.left < 80


def test_an_image_that_is_wrong_alone_is_seen_and_no_slow_error_is() -> None:
    rng = np.random.default_rng(13)
    load, images = rng.standard_normal(T), rng.standard_normal((T, N_Z))
    wrong = images.copy()
    wrong[33] *= 4
    found = after_a_fit(load, wrong)
    assert not found.accepted and found.image_outlier < 1e-3 and found.image_slow > 0.01


def test_too_few_images_for_a_serial_test_have_none() -> None:
    few = 12
    data = Data(cast(Any, SimpleNamespace(n_z=N_Z)), np.zeros(few), 1.0, 0.0, np.arange(few))
    rng = np.random.default_rng(4)
    jacobian = rng.standard_normal((5, few * (1 + N_Z)))
    rest = evaluation(np.sin(np.arange(few * (1 + N_Z)) / 9), jacobian, n_load=few)
    found = goodness_of_fit(rest, data, [], np.zeros((0, few * (1 + N_Z))), NO_SHAPES)
    assert found.load_serial == 1.0
