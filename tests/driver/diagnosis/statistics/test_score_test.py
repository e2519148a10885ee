from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import kstest, multivariate_normal, multivariate_t

from driver.diagnosis.causes.causes import Cause
from driver.diagnosis.statistics.bayes_factor import prior_scaled, projected
from driver.diagnosis.statistics.score_test import (
    Score,
    Together,
    score,
    score_together,
    significance,
    subspace_similarity,
)
from driver.identification.objective import Evaluation
from meshes.arrays import FloatArray
from solver_adapters.parameter import Parameter
from tests.driver.analytic import evaluation

N, K = 30, 4
RNG = np.random.default_rng(8)
J = RNG.standard_normal((K, N))
C = RNG.standard_normal((2, N))
WEIGHT = np.array([0.0, 0.5, 4.0, 0.0])
MEAN = np.array([0.0, 0.3, -0.2, 0.0])
ONE = Cause("one", "material", ("tau0_112",), "", "")
TWO = Cause("two", "material", ("n", "K"), "", "")
RISING = Cause("rising", "material", ("Q",), "", "", one_sided=True)


def fitted(data: FloatArray, weight: FloatArray = WEIGHT, off: float = 0.0) -> Evaluation:
    """The evaluation of the model Jᵀθ at its optimum, or `off` it."""
    best = np.linalg.solve(J @ J.T + np.diag(weight), J @ data + weight * MEAN) + off
    return evaluation(data - best @ J, J, weight, MEAN - best)


def log_bayes(data: FloatArray, sensitivity: FloatArray, weight: FloatArray) -> float:
    """Log Bayes factor from the marginal likelihoods of both models, summed over a grid of effects.

    A flat prior is one of standard deviation 10⁴: its volume is the same in both models.
    """
    variance = np.where(weight > 0, 1 / np.maximum(weight, 1e-300), 1e8)
    null = multivariate_normal(np.zeros(N), np.eye(N) + J.T @ np.diag(variance) @ J)
    known = (MEAN * (weight > 0)) @ J
    line = np.linspace(-8.0, 8.0, 401)
    grid = np.stack(np.meshgrid(*[line] * len(sensitivity), indexing="ij"), -1)
    effects = grid.reshape(-1, len(sensitivity))
    prior = multivariate_t(np.zeros(len(sensitivity)), df=4).pdf(effects)
    likelihood = np.exp(
        null.logpdf(data - known - effects @ sensitivity) - null.logpdf(data - known)
    )
    return float(np.log(prior @ likelihood * (line[1] - line[0]) ** len(sensitivity)))


@pytest.mark.parametrize(("cause", "rows"), [(ONE, [0]), (TWO, [0, 1])])
@pytest.mark.parametrize("size", [0.0, 1.0])
def test_the_evidence_is_the_bayes_factor_of_a_linear_model(
    cause: Cause, rows: list[int], size: float
) -> None:
    data = RNG.standard_normal(N) + size * np.ones(len(rows)) @ C[rows]
    found = score(cause, C[rows], fitted(data), family=1)
    assert found.log_evidence == pytest.approx(log_bayes(data, C[rows], WEIGHT), abs=1e-4)


def test_the_estimate_is_that_of_fitting_all_together() -> None:
    data = RNG.standard_normal(N) + C[0] - 0.5 * C[1]
    found = score(TWO, C, fitted(data), family=1)
    every, weight = np.concatenate([J, C]), np.concatenate([WEIGHT, [1 / 9, 1 / 9]])
    covariance = np.linalg.inv(every @ every.T + np.diag(weight))
    mean = covariance @ (every @ data + weight * np.concatenate([MEAN, [0, 0]]))
    np.testing.assert_allclose(found.estimate, mean[K:], rtol=1e-9)
    np.testing.assert_allclose(found.sigma, np.sqrt(np.diag(covariance)[K:]), rtol=1e-9)


def test_a_baseline_a_little_off_its_optimum_has_the_same_scores() -> None:
    data = RNG.standard_normal(N) + C[0]
    at, off = (score(ONE, C[:1], fitted(data, off=by), family=1) for by in (0.0, 0.3))
    assert off.statistic == pytest.approx(at.statistic)
    assert off.log_evidence == pytest.approx(at.log_evidence)


def test_the_statistic_is_the_misfit_that_freeing_the_cause_removes() -> None:
    data = RNG.standard_normal(N) + C[0]
    flat = np.zeros(K)
    every = np.concatenate([J, C])

    def misfit(model: FloatArray) -> float:
        rest = data - model.T @ np.linalg.lstsq(model.T, data, rcond=None)[0]
        return float(rest @ rest)

    found = score(TWO, C, fitted(data, flat), family=1)
    assert found.statistic == pytest.approx(misfit(J) - misfit(every)) and found.degrees == 2


@pytest.mark.parametrize(("cause", "rows"), [(ONE, [0]), (TWO, [0, 1])])
def test_probabilities_are_uniform_where_nothing_is_wrong(cause: Cause, rows: list[int]) -> None:
    rng = np.random.default_rng(1)
    flat = np.zeros(K)
    draws = rng.standard_normal((2000, N))
    p = [score(cause, C[rows], fitted(data, flat), family=1).p for data in draws]
    assert kstest(p, "uniform").pvalue > 0.01


def test_a_one_sided_cause_is_found_on_its_side_alone() -> None:
    rng = np.random.default_rng(2)
    flat = np.zeros(K)
    draws = rng.standard_normal((2000, N))
    p = np.array([score(RISING, C[:1], fitted(d, flat), family=1).p for d in draws])
    assert np.mean(p == 1.0) == pytest.approx(0.5, abs=0.04)
    assert kstest(2 * p[p < 1], "uniform").pvalue > 0.01
    up, down = (score(RISING, C[:1], fitted(d + s * 3 * C[0], flat), 1) for d, s in
                ((draws[0], 1), (draws[0], -1)))  # fmt: skip
    assert up.p < 1e-6 and up.estimate[0] > 1 and up.log_evidence > 10
    assert down.p == 1.0 and down.estimate[0] == 0 and down.log_evidence < 0


@pytest.mark.parametrize(("component", "found"), [(-5.0, False), (0.0, False), (5.0, True)])
def test_components_of_a_one_sided_cause_below_its_null_are_no_finding(
    component: float, found: bool
) -> None:
    at, components = fitted(np.zeros(N), np.zeros(K)), np.array([component])
    p = significance(RISING, components, C[:1], at, 1, np.inf)
    assert p < 1e-6 if found else p == 1.0


def test_causes_that_do_no_more_than_what_is_fitted_explain_nothing_together() -> None:
    """What rounding leaves of them is no direction."""
    at = fitted(RNG.standard_normal(N), np.zeros(K))
    rows = [J[:2], (J[0] - 2 * J[3])[None]]
    assert score_together(rows, at) == Together(0.0, 0, 1.0)


def test_the_probability_counts_the_whole_family() -> None:
    data = RNG.standard_normal(N) + 1.2 * C[0]
    alone, among = (score(ONE, C[:1], fitted(data), family) for family in (1, 25))
    assert among.p == pytest.approx(min(1.0, 25 * alone.p)) and alone.p < 0.04
    assert score(ONE, C[:1], fitted(RNG.standard_normal(N)), 1000).p == 1.0


@pytest.mark.parametrize("hidden", [0.0 * C[0], J[0] - 2 * J[3]], ids=["no effect", "fitted"])
def test_what_the_data_cannot_show_is_said_to_be_invisible(hidden: FloatArray) -> None:
    found = score(ONE, hidden[None], fitted(RNG.standard_normal(N)), family=1)
    assert found.degrees == 0 and found.p == 1.0 and np.isinf(found.visible).all()
    assert found.log_evidence == pytest.approx(0, abs=1e-9)
    assert subspace_similarity(found, score(ONE, C[:1], fitted(RNG.standard_normal(N)), 1)) == 0.0


def test_an_effect_as_large_as_the_visible_one_is_found() -> None:
    rng = np.random.default_rng(3)
    flat = np.zeros(K)
    visible = float(score(ONE, C[:1], fitted(np.zeros(N), flat), 1).visible[0])
    draws = rng.standard_normal((400, N))

    def share(size: float) -> float:
        p = [score(ONE, C[:1], fitted(d + size * C[0], flat), 25).p for d in draws]
        return float(np.mean(np.array(p) < 0.01))

    assert share(visible) > 0.8 and share(0.3 * visible) < 0.2


def test_what_the_model_may_be_off_hides_each_parameter_by_what_lies_along_it() -> None:
    """An error of so many standard deviations of a parameter, and of none of the other."""
    flat = fitted(np.zeros(N), np.zeros(K))
    left, _, information = projected(C[:2], flat)
    for variance in (1.0, 4.0):
        alone = score(TWO, C[:2], flat, 1, variance=variance)
        # Along the dual of the first parameter nothing lies along the second.
        dual = np.linalg.solve(information, left)[0]
        off = 3.0 * dual * np.sqrt(variance * information[0, 0])
        beside = score(TWO, C[:2], flat, 1, variance=variance, off=off)
        np.testing.assert_allclose(beside.visible / alone.visible, [10.0**0.5, 1.0])
        assert beside.p == alone.p


def test_two_parameters_of_one_effect_count_as_one() -> None:
    data = RNG.standard_normal(N) + C[0]
    twice = score(TWO, np.stack([C[0], -2 * C[0]]), fitted(data), family=1)
    once = score(ONE, C[:1], fitted(data), family=1)
    assert twice.degrees == 1 and twice.statistic == pytest.approx(once.statistic)


def test_causes_are_parallel_if_they_differ_by_what_is_fitted() -> None:
    baseline = fitted(RNG.standard_normal(N), np.zeros(K))

    def of(sensitivity: FloatArray) -> Score:
        return score(ONE if len(sensitivity) == 1 else TWO, sensitivity, baseline, 1)

    one = of(C[:1])
    assert subspace_similarity(one, of(-0.3 * C[:1] + 5 * J[2])) == pytest.approx(1.0)
    residue = np.linalg.lstsq(np.concatenate([J, C[:1]]).T, C[1], rcond=None)[0]
    across = C[1] - residue @ np.concatenate([J, C[:1]])
    assert subspace_similarity(one, of(across[None])) == pytest.approx(0.0, abs=1e-9)


def test_a_cause_of_several_parameters_is_not_parallel_to_one_of_its_effects() -> None:
    """It can do what the other does, but is expected to do as much besides."""
    rows = np.linalg.qr(np.concatenate([J, C]).T)[0].T
    baseline = fitted(RNG.standard_normal(N), np.zeros(K))
    a, b = rows[K], rows[K + 1]

    def of(*effects: FloatArray) -> Score:
        return score(ONE if len(effects) == 1 else TWO, np.stack(effects), baseline, 1)

    assert subspace_similarity(of(a), of(a, b)) == pytest.approx(np.sqrt(0.5))
    assert subspace_similarity(of(a, b), of(a, b + 0.3 * a)) == pytest.approx(1.0)
    # What it does besides counts by how much of it the data show.
    assert subspace_similarity(of(a), of(a, 0.1 * b)) == pytest.approx(np.sqrt(1 / 1.01))


def test_a_noise_level_from_few_degrees_makes_a_large_statistic_likelier() -> None:
    """Effects in the loads alone, their noise estimated from 12 other numbers."""
    rng = np.random.default_rng(4)
    p_known, p = [], []
    for draw, other in zip(
        rng.standard_normal((4000, N)), rng.standard_normal((4000, 12)), strict=True
    ):
        noise = np.sqrt(np.mean(other**2))
        at = replace(fitted(draw, np.zeros(K)), n_load=N)
        found = replace(at, residual=at.residual / noise)
        effect = C[:1] / noise
        found = replace(found, jacobian=found.jacobian / noise)
        p_known.append(score(ONE, effect, found, 1).p)
        p.append(score(ONE, effect, found, 1, load_degrees=12).p)
    assert kstest(p, "uniform").pvalue > 0.01
    assert np.mean(np.array(p_known) < 1e-3) > 5e-3


def test_sensitivities_are_taken_per_prior_scale() -> None:
    parameters = {
        "ratio": Parameter("ratio", "", 1.0, 0.1, 0.3, 3.0, True),
        "shift": Parameter("shift", "µm", 0.0, 0.3),
    }
    # θ of the shift is in scales already, θ of the ratio is its logarithm.
    scaled = prior_scaled(np.ones((2, 5)), ("ratio", "shift"), parameters)
    np.testing.assert_allclose(scaled, [[0.1] * 5, [1.0] * 5])
