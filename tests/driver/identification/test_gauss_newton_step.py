from __future__ import annotations

import numpy as np
import pytest

from driver.identification.gauss_newton_step import (
    LARGEST_STEP,
    bounded_step,
    is_at_bound,
    trial_values,
)
from solver_adapters.parameter import Parameter

FREE = Parameter("a", "", 0.0, 2.0, -4.0, 4.0)
LOG = Parameter("b", "", 1.0, 1.0, 0.5, 2.0, True)


def test_inside_the_range_it_is_the_gauss_newton_step() -> None:
    hessian, gradient = np.array([[4.0, 1.0], [1.0, 3.0]]), np.array([1.0, 0.5])
    step, decrement = bounded_step(hessian, gradient, [FREE, LOG], [0.0, 1.0])
    newton = np.linalg.solve(hessian, gradient)
    np.testing.assert_allclose(step, newton, rtol=1e-9)
    assert decrement == pytest.approx(np.sqrt(gradient @ newton))


def test_a_step_out_of_the_bounds_is_held_and_does_not_count() -> None:
    hessian, gradient = np.array([[4.0, 1.0], [1.0, 3.0]]), np.array([1.0, 0.5])
    step, decrement = bounded_step(hessian, gradient, [FREE, LOG], [4.0, 1.0])
    np.testing.assert_allclose(step, [0.0, 0.5 / 3.0], rtol=1e-9)
    assert decrement == pytest.approx(np.sqrt(0.25 / 3.0))
    assert bounded_step(hessian, -gradient, [FREE, LOG], [4.0, 1.0])[0][0] < 0


def test_a_direction_that_nothing_sees_is_not_followed() -> None:
    step, _ = bounded_step(np.diag([1.0, 0.0]), np.array([0.5, 0.0]), [FREE, LOG], [0.0, 1.0])
    np.testing.assert_allclose(step, [0.5, 0.0], atol=1e-9)
    weak, _ = bounded_step(np.diag([1.0, 1e-9]), np.array([0.5, 1e-3]), [LOG, FREE], [1.0, 0.0])
    assert abs(weak[1]) <= LARGEST_STEP


def test_trial_values_stay_inside_the_bounds() -> None:
    parameters = {"a": FREE, "b": LOG}
    found = trial_values({"a": 1.0, "b": 1.0, "c": 7.0}, "ab", np.array([0.5, 3.0]), parameters)
    assert found == {"a": 2.0, "b": 2.0, "c": 7.0}
    assert is_at_bound(LOG, 2.0) and is_at_bound(LOG, 0.5) and not is_at_bound(FREE, 2.0)
