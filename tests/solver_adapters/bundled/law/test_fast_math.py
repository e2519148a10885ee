"""exp and log against NumPy's in extended precision."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from meshes.arrays import FloatArray
from solver_adapters.bundled.law import fast_math
from tests.solver_adapters.bundled.from_python import FromPython

kernels = FromPython(fast_math)

RNG = np.random.default_rng(0)
LN2, SMALLEST, LARGEST = np.log(2.0), np.finfo(float).tiny, np.finfo(float).max
EXPONENTS = np.concatenate(
    [
        np.linspace(-708.0, 709.0, 4001),
        RNG.uniform(-1.0, 1.0, 4000),
        # Beside the ends of a reduced range, ± ln(2)/2, and of tiny size.
        *((k + 0.5) * LN2 + np.linspace(-1e-12, 1e-12, 5) for k in range(-40, 40)),
        10.0 ** np.arange(-300.0, 0.0, 7.0),
        [0.0],
    ]
)
NUMBERS = np.concatenate(
    [
        np.exp(np.linspace(np.log(SMALLEST), np.log(LARGEST), 4001)[1:-1]),
        RNG.uniform(0.5, 2.0, 4000),
        # Beside 1, where log is small, and beside √½, where the exponent turns over.
        *(1.0 + sign * 2.0 ** -np.arange(1.0, 53.0) for sign in (1, -1)),
        np.sqrt(0.5) * (1.0 + np.arange(-5, 6) * np.finfo(float).eps),
        [1.0, SMALLEST, LARGEST],
    ]
)


def _units(function: Callable[[float], float], exact: FloatArray, at: FloatArray) -> FloatArray:
    """Error in units in the last place of the rounded exact value."""
    found = np.array([function(x) for x in at])
    error = abs(found.astype(np.longdouble) - exact)
    return np.asarray(error / np.spacing(abs(exact.astype(np.float64))), dtype=np.float64)


@pytest.mark.skipif(
    np.finfo(np.longdouble).eps == np.finfo(float).eps, reason="no extended precision here"
)
@pytest.mark.parametrize(
    ("function", "exact", "at"),
    [(kernels.fast_exp, np.exp, EXPONENTS), (kernels.fast_log, np.log, NUMBERS)],
)
def test_the_error_is_at_most_three_units_in_the_last_place(
    function: Callable[[float], float], exact: Callable[[FloatArray], FloatArray], at: FloatArray
) -> None:
    units = _units(function, exact(at.astype(np.longdouble)), at)
    assert units.max() <= 3.0, at[np.argmax(units)]


def test_exp_undoes_log_over_the_rates_of_the_law() -> None:
    for x in np.logspace(-16, 3, 1001):
        assert abs(kernels.fast_exp(10 * kernels.fast_log(x)) / x**10 - 1) < 1e-12
