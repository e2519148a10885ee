"""Against scipy.stats, to the last bit."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from driver.common import distributions as own

DEGREES = (1, 2, 3.5, 17, 120, 4e4)
P = np.logspace(-12, -0.01, 100)
X = np.concatenate([[-1.0, 0.0], np.logspace(-8, 4, 200)])
Z = np.linspace(-40, 40, 401)


def test_the_normal_distribution() -> None:
    np.testing.assert_array_equal(own.normal_sf(Z), stats.norm.sf(Z))
    np.testing.assert_array_equal(own.normal_ppf(P), stats.norm.ppf(P))
    np.testing.assert_array_equal(own.normal_isf(P), stats.norm.isf(P))


@pytest.mark.parametrize("degrees", DEGREES)
def test_distributions_with_degrees_of_freedom(degrees: float) -> None:
    np.testing.assert_array_equal(own.chi2_sf(X, degrees), stats.chi2.sf(X, degrees))
    np.testing.assert_array_equal(own.chi2_isf(P, degrees), stats.chi2.isf(P, degrees))
    np.testing.assert_array_equal(own.t_sf(Z, degrees), stats.t.sf(Z, degrees))
    np.testing.assert_array_equal(own.t_isf(P, degrees), stats.t.isf(P, degrees))
    for below in DEGREES:
        np.testing.assert_array_equal(own.f_sf(X, degrees, below), stats.f.sf(X, degrees, below))


@pytest.mark.parametrize("shape", [0.5, 2.0, 10.0])
def test_the_density_of_the_gamma_distribution(shape: float) -> None:
    found = own.gamma_logpdf(X[2:], shape, 1 / shape)
    np.testing.assert_array_equal(found, stats.gamma.logpdf(X[2:], shape, scale=1 / shape))


def test_a_process_that_fits_loads_none_of_them() -> None:
    load = "import sys, driver.diagnosis.search.refit; print('scipy.stats' in sys.modules)"
    told = subprocess.run(
        [sys.executable, "-c", load], cwd=Path(__file__).parents[3], capture_output=True,
        text=True, check=True,
    )  # fmt: skip
    assert told.stdout == "False\n"
