from __future__ import annotations

import numpy as np
import pytest

from driver.common.errors import InputError
from driver.identification.fit import fit
from driver.identification.identifiability import (
    PriorRule,
    far_off_prior,
    far_off_told,
    null_vector,
    prior_shares,
    refuse_what_is_not_seen,
    ruled_by_prior,
)
from solver_adapters.parameter import Parameter
from tests.driver.analytic import evaluation, formula

RNG = np.random.default_rng(5)
SEEN = RNG.standard_normal((3, 30))


def test_shares_are_those_of_noise_and_prior_in_repeated_experiments() -> None:
    """Scatter of the estimate over draws of prior means alone, against all of its variance."""
    weight = np.array([0.0, 40.0, 2.0])
    here = evaluation(np.zeros(30), SEEN, weight)
    covariance = np.linalg.inv(here.hessian)
    means = RNG.standard_normal((200_000, 3)) * np.where(weight > 0, weight, np.inf) ** -0.5
    scatter = np.var(means @ (covariance * weight).T, axis=0)
    np.testing.assert_allclose(prior_shares(here), scatter / np.diag(covariance), rtol=0.02)


def test_a_parameter_that_the_data_hardly_see_is_named_with_how_far_they_moved_it() -> None:
    """Data that want d at 300, by an information of a hundredth of that of its prior."""
    rows = SEEN / np.linalg.norm(SEEN, axis=1, keepdims=True) * np.array([[9.0], [8.0], [0.2]])
    parameters = [Parameter(name, "", 0.0, 1.0) for name in "abd"]
    prior = {"b": (0.0, 1.0), "d": (0.0, 0.5)}
    objective = formula(
        lambda p: (p @ rows, rows), np.array([0.0, 0.0, 300.0]) @ rows, parameters, prior
    )
    found = fit(objective, dict.fromkeys("abd", 0.0), ("a", "b", "d"), 200, tolerance=1e-9)
    (rule,) = ruled_by_prior(found)
    assert rule.name == "d" and rule.share > 0.98
    assert rule.moved == pytest.approx(found.values["d"] / 0.5) and rule.moved > 4
    assert rule.sentence() == (
        f"d: the data hardly see it; 99% of its variance is that of its prior, "
        f"{rule.moved:+.1f} widths off its mean"
    )
    assert PriorRule("d", 0.7, 0.01).sentence().endswith("its prior, at whose mean it stays")


def test_what_is_more_than_three_widths_off_its_prior_is_told_in_one_sentence() -> None:
    """Data that want λ⁻_Z at 5, τ0 at 2 and d at −4 widths of their priors, and see them well."""
    names = ("lambda_minus_Z", "tau0", "d")
    parameters = [Parameter(name, "", 0.0, 1.0) for name in names]
    wanted = np.array([5.0, 2.0, -4.0]) * (widths := np.array([0.2, 0.2, 0.5]))
    rows = 1e3 * np.linalg.qr(SEEN.T)[0].T
    prior = {name: (0.0, width) for name, width in zip(names, widths, strict=True)}
    objective = formula(lambda p: (p @ rows, rows), wanted @ rows, parameters, prior)
    found = fit(objective, dict.fromkeys(names, 0.0), names, 20, tolerance=1e-9)
    assert far_off_prior(found) == pytest.approx({"lambda_minus_Z": 5.0, "d": -4.0}, rel=1e-4)
    (told,) = far_off_told(found)
    assert told.startswith("far off the prior, in widths of it: λ⁻_Z by +5.0 and d by -4.0; ")
    near = formula(lambda p: (p @ rows, rows), 0.5 * wanted @ rows, parameters, prior)
    assert far_off_told(fit(near, dict.fromkeys(names, 0.0), names, 20, tolerance=1e-9)) == ()


def test_what_data_and_prior_both_see_is_accepted() -> None:
    assert null_vector(evaluation(np.zeros(30), SEEN)) is None
    refuse_what_is_not_seen(evaluation(np.zeros(30), SEEN * np.array([[1e6], [1.0], [1e-6]])))


def test_a_parameter_without_any_effect_is_named() -> None:
    jacobian = SEEN * np.array([[1.0], [0.0], [1.0]])
    here = evaluation(np.zeros(30), jacobian, free=("tau0", "c", "d"))
    with pytest.raises(InputError, match=r"c changes nothing that images and loads show, and no"):
        refuse_what_is_not_seen(here)
    refuse_what_is_not_seen(evaluation(np.zeros(30), jacobian, np.array([0.0, 1e-3, 0.0])))


def test_a_combination_that_is_not_seen_is_named_with_its_parts() -> None:
    jacobian = np.array([SEEN[0], 3 * SEEN[1], -SEEN[1]])
    here = evaluation(np.zeros(30), jacobian, free=("tau0", "c", "d"))
    parts = null_vector(here)
    assert parts is not None and set(parts) == {"c", "d"}
    assert abs(parts["c"]) == pytest.approx(1.0) and parts["c"] * parts["d"] > 0
    with pytest.raises(InputError) as error:
        refuse_what_is_not_seen(here)
    assert str(error.value).startswith(
        "identification: found that images and loads do not tell c, d apart (nothing changes along"
    )
    assert "\n" not in str(error.value)
