"""Back strain over a step, and its slopes, beside their formulas in 60 decimal digits."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from decimal import Decimal, localcontext

import pytest

from solver_adapters.bundled.law import back_strain
from tests.solver_adapters.bundled.from_python import FromPython

kernels = FromPython(back_strain)

RECALL = 1500.0
# Products d Δp: tiny, on both sides of where a series gives way (1e-3, 1e-2), moderate, saturated.
PRODUCTS = (0.0, 1e-12, 1e-6, 9.999e-4, 1.0001e-3, 9.99e-3, 1.001e-2, 0.3, 2.0, 30.0)
STARTS = (0.0, 3e-4, -5e-4)

pytestmark = pytest.mark.usefixtures("sixty_digits")


@pytest.fixture
def sixty_digits() -> Iterator[None]:
    with localcontext() as context:
        context.prec = 60
        yield


@pytest.fixture(params=[True, False], ids=["exponential", "backward Euler"])
def exponential(request: pytest.FixtureRequest) -> bool:
    return bool(request.param)


@pytest.fixture(params=PRODUCTS)
def slip(request: pytest.FixtureRequest) -> float:
    return float(request.param) / RECALL


@pytest.fixture(params=STARTS)
def start(request: pytest.FixtureRequest) -> float:
    return float(request.param)


def exact_end(slip: Decimal, d: Decimal, start: float, exponential: bool) -> Decimal:
    """S x at the end of the step: the solution of dx = dp − d x dp, or one Euler step of it."""
    x0 = Decimal(start)
    if not exponential:
        return (x0 + slip) / (1 + d * slip)
    left = (-d * slip).exp()
    return x0 * left + (1 - left) / d


def slope_of(function: Callable[[Decimal], Decimal], at: float, size: float) -> float:
    """Central difference over 1e-20 of a size: its error is below 1e-30."""
    step = Decimal(size) * Decimal("1e-20")
    x = Decimal(at)
    return float((function(x + step) - function(x - step)) / (2 * step))


def found_end(slip: float, start: float, exponential: bool) -> float:
    left = kernels.share_left(RECALL * slip, exponential)
    return float(start * left + kernels.gained(left, slip, RECALL, exponential))


def test_the_back_strain_at_the_end_is_that_of_the_scheme(
    slip: float, start: float, exponential: bool
) -> None:
    exact = float(exact_end(Decimal(slip), Decimal(RECALL), start, exponential))
    # Where the series gives way, (1 − left)/d keeps the rounding of left: 3 units of exp near 1.
    closed = exponential and RECALL * slip > 1e-3
    tolerance = 2e-15 * (abs(start) + abs(exact)) + (4e-16 / RECALL if closed else 0.0)
    assert abs(found_end(slip, start, exponential) - exact) <= tolerance


def test_growth_is_the_slope_along_the_slip(slip: float, start: float, exponential: bool) -> None:
    left = kernels.share_left(RECALL * slip, exponential)
    exact = slope_of(
        lambda p: exact_end(p, Decimal(RECALL), start, exponential), slip, 1.0 / RECALL
    )
    assert kernels.growth(left, start, RECALL, exponential) == pytest.approx(
        exact, rel=3e-14, abs=1e-25
    )


def test_the_recall_slope_is_the_slope_along_d(
    slip: float, start: float, exponential: bool
) -> None:
    left = kernels.share_left(RECALL * slip, exponential)
    exact = slope_of(lambda d: exact_end(Decimal(slip), d, start, exponential), RECALL, RECALL)
    # Above its series the closed form loses 1e-16/u² of Δp², with u ≥ 1e-2.
    tolerance = 1e-11 * slip * slip + 1e-14 * slip * abs(start)
    assert abs(kernels.recall_slope(left, slip, RECALL, start, exponential) - exact) <= tolerance


@pytest.mark.parametrize("threshold", [1e-3, 1e-2])
def test_series_and_closed_forms_meet(threshold: float) -> None:
    """Of the gained back strain at 1e-3, of the recall slope at 1e-2."""
    below, above = (threshold * (1.0 + sign * 1e-13) / RECALL for sign in (-1, 1))

    def gain(slip: float) -> float:
        return float(kernels.gained(kernels.share_left(RECALL * slip, True), slip, RECALL, True))

    def slope(slip: float) -> float:
        return float(
            kernels.recall_slope(kernels.share_left(RECALL * slip, True), slip, RECALL, 0.0, True)
        )

    assert gain(below) == pytest.approx(gain(above), rel=1e-12)
    assert slope(below) == pytest.approx(slope(above), rel=2e-11)


def test_a_long_slip_leaves_nothing_and_saturates_the_back_strain() -> None:
    assert kernels.share_left(1e6, True) < 1e-250
    assert found_end(1e6 / RECALL, 3e-4, True) == 1.0 / RECALL
