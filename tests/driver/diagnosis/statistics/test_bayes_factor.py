from __future__ import annotations

from dataclasses import replace
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import multivariate_t, t

from driver.diagnosis.causes.causes import Cause
from driver.diagnosis.search.refit import as_wide_as_found, with_prior
from driver.diagnosis.statistics.bayes_factor import (
    amounts_of,
    log_bayes_factor,
    log_mean_likelihood,
)
from driver.diagnosis.statistics.score_test import score
from driver.identification.objective import Evaluation, Objective
from driver.identification.priors import FREED_WIDTH
from meshes.arrays import FloatArray
from solver_adapters.parameter import Parameter
from tests.driver.analytic import formula

RNG = np.random.default_rng(9)
A = RNG.standard_normal((5, 50))
PARAMETERS = [
    Parameter("a", "", 0.0, 1.0), Parameter("b", "", 0.0, 0.5), Parameter("Q", "MPa", 0.0, 10.0),
    Parameter("load_drift", "µN", 0.0, 20.0), Parameter("d2", "", 0.0, 2.0),
]  # fmt: skip
ZERO = {p.name: 0.0 for p in PARAMETERS}


@pytest.mark.parametrize(
    ("g", "a"),
    [(0.0, 0.0), (0.0, 1.0), (10.0, 4.0), (-3.0, 0.2), (0.0, 400.0), (100.0, 20.0), (1e4, 500.0)],
)
def test_the_mean_likelihood_is_that_over_the_t_distribution(g: float, a: float) -> None:
    """Adaptive quadrature of SciPy, of the likelihood over its largest value."""
    at = g / a if a else 0.0
    far = 40.0 / np.sqrt(a) if a else np.inf

    def part(x: float) -> float:
        return float(t.pdf(x, 4) * np.exp(-0.5 * a * (x - at) ** 2))

    around = [0.0, at] if a else None
    mean, _ = quad(part, min(at, 0.0) - far, max(at, 0.0) + far, points=around, limit=500)
    found = log_mean_likelihood(np.array([g]), np.array([[a]]), (1,))
    assert found == pytest.approx(0.5 * g * at + np.log(mean), abs=1e-4)


@pytest.mark.parametrize(
    ("g", "a"), [(0.0, 1.0), (10.0, 4.0), (-3.0, 4.0), (-40.0, 9.0), (0.4, 0.01)]
)
def test_what_can_only_be_above_its_null_has_all_of_its_prior_there(g: float, a: float) -> None:
    mean, _ = quad(
        lambda x: float(2 * t.pdf(x, 4) * np.exp(g * x - 0.5 * a * x**2)),
        0.0, max(g, 0.0) / a + 40.0 / np.sqrt(a), points=[0.1, max(g / a, 0.2)], limit=500,
    )  # fmt: skip
    found = log_mean_likelihood(np.array([g]), np.array([[a]]), (1,), (0,))
    assert found == pytest.approx(np.log(mean), abs=2e-4)


def test_of_two_effects_one_may_lie_on_either_side() -> None:
    line = np.linspace(-12.0, 14.0, 1301)
    grid = np.stack(np.meshgrid(line, line, indexing="ij"), -1)
    g, info = np.array([1.0, 2.0]), np.array([[3.0, 0.1], [0.1, 2.0]])
    prior = t.pdf(grid[..., 0], 4) * t.pdf(grid[..., 1], 4)
    likelihood = np.exp(grid @ g - 0.5 * np.einsum("...i,ij,...j->...", grid, info, grid))
    edge = np.where(np.isclose(line, 0.0, atol=1e-9), 0.5, 1.0) * (line > -1e-9)
    exact = np.log(np.sum(2 * edge[:, None] * prior * likelihood) * (line[1] - line[0]) ** 2)
    assert log_mean_likelihood(g, info, (1, 1), (0,)) == pytest.approx(exact, abs=2e-3)


@pytest.mark.parametrize("sizes", [(2,), (1, 1)])
def test_numbers_of_one_cause_are_large_together_and_those_of_two_each_for_itself(
    sizes: tuple[int, ...],
) -> None:
    line = np.linspace(-12.0, 14.0, 1301)
    grid = np.stack(np.meshgrid(line, line, indexing="ij"), -1)
    g, info = np.array([6.0, 9.0]), np.array([[3.0, 1.0], [1.0, 2.0]])
    both = multivariate_t(np.zeros(2), df=4).pdf(grid)
    each = t.pdf(grid[..., 0], 4) * t.pdf(grid[..., 1], 4)
    prior = both if sizes == (2,) else each
    exponent = grid @ g - 0.5 * np.einsum("...i,ij,...j->...", grid, info, grid)
    exact = np.log(np.sum(prior * np.exp(exponent)) * (line[1] - line[0]) ** 2)
    assert log_mean_likelihood(g, info, sizes) == pytest.approx(exact, abs=1e-4)


def test_four_scales_cost_half_of_what_they_would_under_a_gaussian() -> None:
    """Sharply seen, an effect costs the log of its prior density."""
    a = 1e4

    def cost(size: float) -> float:
        of_size = log_mean_likelihood(np.array([size * a]), np.array([[a]]), (1,))
        return 0.5 * a * size**2 - of_size

    assert cost(4.0) - cost(0.0) == pytest.approx(2.5 * np.log(5.0), abs=0.01)
    assert cost(4.0) - cost(0.0) < 0.55 * 8.0


def along(rows: FloatArray, p: FloatArray) -> tuple[FloatArray, FloatArray]:
    return p @ rows, rows


def objective_of(measured: FloatArray, rows: FloatArray = A) -> Objective:
    return formula(partial(along, rows), measured, PARAMETERS, {"b": (0.2, 0.4)})


def fitted(objective: Objective, free: tuple[str, ...]) -> Evaluation:
    """The optimum of a linear model: a fit ends where a large excess falls by a hundredth."""
    at = objective.evaluate(ZERO, free)
    step = np.linalg.solve(at.hessian, at.gradient)
    moved = {n: objective.parameters[n].value(s, 0.0) for n, s in zip(free, step, strict=True)}
    return objective.evaluate(ZERO | moved, free)


@pytest.mark.parametrize("added", [("Q",), ("Q", "load_drift")])
@pytest.mark.parametrize("size", [0.0, 5.0, 40.0])
@pytest.mark.parametrize("seen", [1.0, 0.05, 0.02])
def test_where_the_model_is_linear_the_refit_has_the_evidence_of_the_score(
    added: tuple[str, ...], size: float, seen: float
) -> None:
    """Also where a prior scale moves the data by a σ, and where by a third of it."""
    rows = A * np.array([1.0, 1.0, seen, seen, 1.0])[:, None]
    measured = rows.T @ [0.5, 0.1, 0.1 * size / seen, 0.0, 0.0] + RNG.standard_normal(50)
    cause = Cause("x", "material", added, "", "")
    bare = objective_of(measured, rows)
    before, refit = fitted(bare, ("a", "b")), with_prior(bare, cause)
    after = fitted(refit, ("a", "b", *added))
    found = score(cause, bare.evaluate(before.values, added).jacobian, before, 1)
    evidence = log_bayes_factor(before, after, refit, [added], ())
    assert evidence == pytest.approx(found.log_evidence, rel=1e-5, abs=1e-5)


def test_the_gaussian_under_which_a_cause_was_fitted_does_not_matter() -> None:
    measured = A.T @ [0.5, 0.1, 4.0, 0.0, 0.0] + RNG.standard_normal(50)
    cause = Cause("x", "material", ("Q",), "", "")
    bare = objective_of(measured)
    before = fitted(bare, ("a", "b"))
    refit = with_prior(bare, cause)
    wider = as_wide_as_found(refit, cause, {"Q": 50.0 * FREED_WIDTH})
    one, other = (
        log_bayes_factor(before, fitted(o, ("a", "b", "Q")), o, [("Q",)], ())
        for o in (refit, wider)
    )
    assert refit.prior["Q"] != wider.prior["Q"] and one == pytest.approx(other, rel=1e-7)


def test_a_fit_that_has_not_converged_has_the_evidence_of_what_it_has_reached() -> None:
    """Halfway, a parabola with the slope of its end promises all that is still to be gained."""
    measured = A.T @ [0.5, 0.1, 4.0, 0.0, 0.0] + RNG.standard_normal(50)
    bare = objective_of(measured)
    refit = with_prior(bare, Cause("x", "material", ("Q",), "", ""))
    before, end = fitted(bare, ("a", "b")), fitted(refit, ("a", "b", "Q"))
    halfway = {name: 0.5 * (before.values[name] + end.values[name]) for name in ZERO}
    half = refit.evaluate(halfway, ("a", "b", "Q"))
    whole, part = (log_bayes_factor(before, at, refit, [("Q",)], ()) for at in (end, half))
    assert whole - part > 0.4 * (half.cost - end.cost) > 10


def test_a_larger_prior_scale_costs_the_evidence_of_a_small_effect() -> None:
    measured = 0.5 * A[0] + 0.3 * A[2]

    def evidence(scale: float) -> float:
        parameters = [PARAMETERS[0], Parameter("b", "", 0.0, 1.0), Parameter("Q", "", 0.0, scale)]
        few = A[:3]
        objective = formula(
            lambda p: (p @ few, few), measured, parameters, {"Q": (0.0, FREED_WIDTH)}
        )  # fmt: skip
        before, after = fitted(objective, ("a",)), fitted(objective, ("a", "Q"))
        return log_bayes_factor(before, after, objective, [("Q",)], ())

    assert evidence(10.0) - evidence(100.0) == pytest.approx(np.log(10), abs=0.01)


def test_a_companion_counts_with_its_gaussian_and_with_what_it_is_marginalised_over() -> None:
    """One that does nothing costs nothing."""
    nothing = A.copy()
    nothing[4] = 0.0
    measured = A.T @ [0.5, 0.1, 1.0, 0.0, 0.0] + RNG.standard_normal(50)
    prior = {"b": (0.2, 0.4), "Q": (0.0, FREED_WIDTH), "d2": (0.0, 0.4)}
    for curve, least in ((nothing, 0.0), (A, 1.0)):
        objective = formula(partial(along, curve), measured, PARAMETERS, prior)
        before = fitted(objective, ("a", "b"))
        alone, beside = (
            log_bayes_factor(before, fitted(objective, ("a", "b", "Q", *more)), objective,
                             [("Q",)], more)
            for more in ((), ("d2",))
        )  # fmt: skip
        assert beside == pytest.approx(alone, abs=1e-9) if not least else alone - beside > least


def test_a_flip_has_no_effect_to_average_over() -> None:
    objective = objective_of(A.T @ [0.5, 0.1, 0.0, 0.0, 0.0] + RNG.standard_normal(50))
    at = fitted(objective, ("a", "b"))
    assert log_bayes_factor(at, at, objective, [()], ()) == pytest.approx(0.0, abs=1e-7)


def test_amounts_are_in_prior_scales_off_the_null_that_the_case_moves() -> None:
    known = {
        "n": Parameter("n", "", 10.0, 0.3, logarithmic=True),
        "Q": Parameter("Q", "MPa", 0.0, 10.0),
    }
    model: Any = SimpleNamespace(null_values=lambda: {"n": 20.0, "Q": 0.0})
    objective: Any = SimpleNamespace(parameters=known, model=model)
    amounts = amounts_of(("n", "Q"), {"n": 20.0 * np.exp(0.6), "Q": -15.0}, objective)
    np.testing.assert_allclose(amounts, [2.0, -1.5])


def test_two_causes_of_different_sizes_have_the_evidence_of_their_product_prior() -> None:
    """Orthogonal effects: the sum of what each would have alone."""
    rows = np.linalg.qr(A.T)[0].T * 6.0
    measured = rows.T @ [0.5, 0.1, 8.0, 200.0, 2.0] + RNG.standard_normal(50)
    objective = objective_of(measured, rows)
    for name, parameter in objective.parameters.items():
        if name not in ("a", "b"):
            prior = {**objective.prior, name: (0.0, FREED_WIDTH * parameter.width)}
            objective = replace(objective, prior=prior)
    before = fitted(objective, ("a", "b"))

    def evidence(*effects: tuple[str, ...]) -> float:
        free = ("a", "b", *(name for one in effects for name in one))
        return log_bayes_factor(before, fitted(objective, free), objective, effects, ())

    both = evidence(("Q",), ("load_drift", "d2"))
    assert both == pytest.approx(evidence(("Q",)) + evidence(("load_drift", "d2")), rel=1e-9)
    assert abs(both - evidence(("Q", "load_drift", "d2"))) > 0.1  # one prior for all
