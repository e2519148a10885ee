"""Exponents of costs."""

from __future__ import annotations

import pytest

from benchmarks.growth import exponent


def test_the_exponent_is_the_power_of_the_size() -> None:
    assert exponent({10: 3.0, 20: 12.0, 80: 192.0}) == pytest.approx(2.0)
    assert exponent({1: 8.0, 2: 4.0, 8: 1.0}) == pytest.approx(-1.0)
