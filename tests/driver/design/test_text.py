from __future__ import annotations

import numpy as np
import pytest

from driver.design.text import in_words, shown
from driver.results.design import Gain


@pytest.mark.parametrize(
    ("value", "unit", "relative", "text"),
    [
        (0.0349, "rad", False, "2 °"),
        (0.0128, "µm", False, "13 nm"),
        (0.28, "µm", False, "0.28 µm"),
        (0.015, "", True, "1.5 %"),
        (1.2, "", True, "× 3.3"),
        (40000.0, "MPa", False, "40000 MPa"),
        (0.03, "", False, "0.03"),
        (np.inf, "MPa", False, "—"),
    ],
)
def test_magnitudes_are_told_in_units_of_a_person(
    value: float, unit: str, relative: bool, text: str
) -> None:
    assert shown(value, unit, relative) == text


def test_a_gain_is_told_by_what_it_does_best() -> None:
    won = Gain(
        sigma={"tau0": 0.5, "c": 0.99, "elongation_1": 0.8, "elongation_2": 0.2},
        seen={"load_gain": 0.7, "family_112": 1.4},
        parted=(("a", "b"),), merged=(), shown=("load_gain",), lost=("family_112",),
    )  # fmt: skip
    assert in_words(won) == (
        "best for the knots × 0.40, tau0 × 0.50, load_gain × 0.70; shows load_gain; "
        "no longer shows family_112; parts a and b"
    )
    assert in_words(Gain({"c": 0.99}, {}, (), (), (), ())) == "buys nothing"
