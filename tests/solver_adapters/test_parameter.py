from __future__ import annotations

import pytest

from solver_adapters.parameter import Parameter

LOG = Parameter("tau0", "MPa", 40.0, 1.0, 0.1, 2000.0, True)
PLAIN = Parameter("shift", "µm", 0.0, 0.3, -3.0, 3.0)


@pytest.mark.parametrize(
    ("parameter", "value", "reference", "theta"),
    [(LOG, 40.0 * 2.718281828459045, 40.0, 1.0), (PLAIN, 0.8, 0.2, 2.0)],
)
def test_theta_and_value_are_inverse(
    parameter: Parameter, value: float, reference: float, theta: float
) -> None:
    assert parameter.theta(value, reference) == pytest.approx(theta)
    assert parameter.value(theta, reference) == pytest.approx(value)


@pytest.mark.parametrize("parameter", [LOG, PLAIN], ids=["logarithmic", "plain"])
def test_the_slope_is_that_of_the_value(parameter: Parameter) -> None:
    h, here = 1e-6, 1.7
    difference = (parameter.value(h, here) - parameter.value(-h, here)) / (2 * h)
    assert parameter.slope(here) == pytest.approx(difference)


def test_a_typical_change_is_one_prior_scale() -> None:
    assert Parameter("n", "", 10.0, 0.3, 1.5, 60.0, True).change(20.0) == pytest.approx(6.0)
    assert PLAIN.change(20.0) == 0.3


def test_a_value_stays_inside_the_bounds() -> None:
    assert PLAIN.value(100.0, 0.0) == 3.0 and PLAIN.value(-100.0, 0.0) == -3.0
    assert LOG.value(50.0, 40.0) == 2000.0 and LOG.value(-50.0, 40.0) == 0.1


def test_a_prior_scale_is_one_in_theta_but_for_a_logarithm() -> None:
    assert PLAIN.width == 1.0 and PLAIN.theta(PLAIN.null + PLAIN.scale, PLAIN.null) == 1.0
    ratio = Parameter("tau0_112", "", 1.0, 0.1, 0.3, 3.0, True)
    assert ratio.width == 0.1 and ratio.value(ratio.width, 1.0) == pytest.approx(1.1, abs=0.01)
