from __future__ import annotations

import math

import numpy as np

from solver_adapters.bundled.elementary import fast_exp, fast_log

FEW_ULP = 4 * 4e-16


def test_exp_is_accurate_to_a_few_units_in_the_last_place() -> None:
    for x in [*np.linspace(-700, 700, 2003), *np.linspace(-1, 1, 1001), 0.0, 0.5 * math.log(2)]:
        assert abs(fast_exp(x) / math.exp(x) - 1) < FEW_ULP


def test_log_is_accurate_to_a_few_units_in_the_last_place() -> None:
    values = [*np.exp(np.linspace(-690, 690, 2003)), *np.linspace(0.5, 2.0, 1001), math.sqrt(0.5)]
    for x in values:
        assert abs(fast_log(x) - math.log(x)) <= FEW_ULP * abs(math.log(x))


def test_exp_undoes_log_over_the_rates_of_the_law() -> None:
    for x in np.logspace(-16, 3, 1001):
        assert abs(fast_exp(10 * fast_log(x)) / x**10 - 1) < 1e-12
