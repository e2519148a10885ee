import math

import numpy as np
import pytest
from scipy import stats

from driver.parameters.registry import declared_parameters
from driver.report.identified import COVERED, IdentifiedParameter, estimates
from solver_adapters.parameter import Parameter

POSITIVE = Parameter("p", "MPa", 40.0, 1.0, 1.0, 100.0, True)
OTHER = Parameter("q", "", 1.0, 0.1, -3.0, 5.0)


def test_the_interval_holds_95_percent_of_a_normal_distribution() -> None:
    assert stats.norm.cdf(COVERED) - stats.norm.cdf(-COVERED) == pytest.approx(0.95, abs=1e-6)


def test_the_interval_of_a_positive_parameter_is_symmetric_in_its_logarithm() -> None:
    low, high = IdentifiedParameter(POSITIVE, 40.0, 21.0, 0.9, math.nan, math.inf, 0.0).interval
    assert low > 0 and low * high == pytest.approx(21.0**2)
    assert math.log(high / low) == pytest.approx(2 * COVERED * 0.9)


def test_the_interval_of_another_parameter_is_symmetric_about_its_value() -> None:
    found = IdentifiedParameter(OTHER, 1.0, 0.8, 0.2, 1.0, 2.0, 0.01)
    assert found.interval == pytest.approx((0.8 - COVERED * 0.02, 0.8 + COVERED * 0.02))
    assert found.prior_interval == pytest.approx((1 - COVERED * 0.2, 1 + COVERED * 0.2))
    assert found.sigma == pytest.approx(0.02)


def test_without_a_prior_there_is_no_interval_of_it() -> None:
    assert IdentifiedParameter(OTHER, 1.0, 1.0, 0.3, math.nan, math.inf, 0.0).prior_interval is None


@pytest.mark.parametrize(("value", "bound"), [(100.0, 100.0), (1.0, 1.0), (99.0, None)])
def test_a_parameter_on_its_bound_is_told(value: float, bound: float | None) -> None:
    assert IdentifiedParameter(POSITIVE, 40.0, value, 0.1, 40.0, 1.0, 0.01).at_bound == bound


def test_estimates_take_their_row_of_the_results() -> None:
    results = {
        "start": np.array([40.0, 1.0]), "values": np.array([21.0, 0.8]),
        "covariance": np.diag([0.01, 0.04]), "prior/mean": np.array([40.0, np.nan]),
        "prior/width": np.array([1.0, np.inf]),
        "prior_share": np.array([0.01, 0.0]),
    }  # fmt: skip
    declared = declared_parameters(2)
    found = estimates(["tau0", "lambda_plus_Y"], declared, results)
    expected = IdentifiedParameter(declared["tau0"], 40.0, 21.0, 0.1, 40.0, 1.0, 0.01)
    assert found["tau0"] == expected
    assert found["lambda_plus_Y"].deviation == pytest.approx(0.2)
