from __future__ import annotations

import numpy as np
import pytest

from driver.case.inference import Identification
from driver.identification.fit import fit
from driver.identification.priors import LAMBDA_PRIOR, prior_of, tikhonov_width, widths
from driver.parameters.boundary import LAMBDAS
from driver.parameters.registry import declared_parameters
from solver_adapters.parameter import Parameter
from tests.driver.analytic import formula

PARAMETERS = declared_parameters(5)
START = {name: 1.1 for name in LAMBDAS} | {"tau0": 40.0, "c": 40e3, "d": 1500.0, "Q": 5.0}
N_IMAGES, N_PIXELS = 97, 3672


def priors(**keys: object) -> dict[str, tuple[float, float]]:
    return prior_of(Identification.model_validate(keys), START, PARAMETERS, N_IMAGES, N_PIXELS)


def test_a_gaussian_prior_has_the_stated_widths_about_the_start() -> None:
    found = priors(prior_width={"tau0": 0.3})
    assert found["tau0"] == (40.0, 0.3) and found["c"] == (40e3, 1.0)
    assert found["lambda_plus_Y"] == pytest.approx((1.1, LAMBDA_PRIOR / 0.1))
    assert set(found) == {*LAMBDAS, "tau0", "c", "d"}


def test_without_a_prior_there_is_none_but_starts_still_scatter() -> None:
    assert priors(prior="none") == {}
    scatter = widths(Identification(prior="none"), PARAMETERS)
    assert scatter["d"] == 1.0 and scatter["lambda_minus_Z"] == pytest.approx(2.0)


def test_lambda_star_holds_every_parameter_alike() -> None:
    found = priors(prior="tikhonov", lambda_star=1e-6, parameters=("tau0", "Q"))
    width = (2 * 97 * 3673 * 1e-6) ** -0.5
    assert found["tau0"] == pytest.approx((40.0, width))
    assert found["Q"] == pytest.approx((5.0, width))
    # θ of an amplitude is in tenths.
    assert found["lambda_plus_Z"] == pytest.approx((1.1, 10 * width))


def test_a_weight_of_one_over_twice_the_data_is_a_gaussian_of_width_one() -> None:
    assert tikhonov_width(1 / (2 * 97 * 3673), 97, 3672) == pytest.approx(1.0)


def test_the_width_gives_the_step_of_the_paper() -> None:
    """(M + λ*I) δq = b + λ*(q₀ − q), M and b of the functional per pixel and image (2.17)."""
    rng = np.random.default_rng(1)
    n_images, n_pixels, gamma, weight = 6, 9, 2.0, 3e-3
    S = rng.standard_normal((2, n_images * n_pixels))
    rho = 1.0 * rng.standard_normal(n_images * n_pixels)
    at, reference = np.array([1.3, 0.8]), np.array([1.0, 1.0])
    per_datum = 1 / (2 * gamma**2 * n_images * (1 + n_pixels))
    gap = np.log(reference / at)
    # S is that of the motion by log p; χ̄² has the gradient −2 S ρ · per_datum.
    expected = np.linalg.solve(
        per_datum * S @ S.T + weight * np.eye(2), per_datum * S @ rho + weight * gap
    )
    width = tikhonov_width(weight, n_images, n_pixels)
    logarithmic = [Parameter(name, "", 1.0, 1.0, 1e-6, 1e6, True) for name in "ab"]
    objective = formula(
        lambda p: ((np.log(p / at) @ S) / gamma, S / gamma / p[:, None]),
        rho / gamma,
        logarithmic,
        {"a": (1.0, width), "b": (1.0, width)},
    )
    found = fit(objective, {"a": at[0], "b": at[1]}, "ab", 9, tolerance=1e-9)
    step = np.log([found.values[n] / a for n, a in zip("ab", at, strict=True)])
    np.testing.assert_allclose(step, expected, rtol=1e-6)
