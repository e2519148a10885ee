import math

import pytest

from driver.common.formatting import (
    age,
    byte_size,
    chi,
    compact,
    duration,
    interval,
    number,
    percent,
    printable,
    probability,
    signed,
    with_sigma,
)


@pytest.mark.parametrize(
    ("value", "sigma", "text"),
    [
        (21.3412, 0.1234, "21.34 ± 0.12"),
        (1.14932, 0.0041, "1.149 ± 0.004"),
        (44123.4, 350.0, "44100 ± 400"),
        (44123.4, 2500.0, "44100 ± 2500"),
        (-3.2, 0.96, "−3.2 ± 1.0"),
        (0.0, 0.2, "0.00 ± 0.20"),
        (3.2e-7, 1.4e-8, "(3.20 ± 0.14)·10⁻⁷"),
        (12.3456, 0.0, "12.35"),
        (12.3456, None, "12.35"),
        (12.3456, math.nan, "12.35"),
    ],
)
def test_a_value_shows_the_digits_that_its_sigma_leaves(
    value: float, sigma: float | None, text: str
) -> None:
    assert with_sigma(value, sigma) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"), (1.0, "1.00"), (-0.05, "−0.0500"), (1270.5, "1270"), (2.31e7, "2.31·10⁷"),
        (-9.999e-6, "−1.00·10⁻⁵"), (None, "–"), (math.inf, "–"),
    ],
)  # fmt: skip
def test_a_number_has_three_digits(value: float | None, text: str) -> None:
    assert number(value) == text


def test_signs_probabilities_and_chi_are_written_as_in_print() -> None:
    assert (signed(0.14), signed(-2.0), signed(0.0)) == ("+0.140", "−2.00", "0")
    assert [probability(p) for p in (1.0, 0.234, 3.2e-7, 9.6e-7, 0.0)] == [
        "1", "0.23", "3·10⁻⁷", "1·10⁻⁶", "< 10⁻⁹⁹",
    ]  # fmt: skip
    assert [chi(x) for x in (0.98, 6.7, 58.1, 123.0)] == ["0.98", "6.70", "58.1", "123"]


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0, "0"), (0.011, "0.011"), (-430.4, "−430"), (9994.0, "9994"), (9996.0, "1·10⁴"),
     (-4.2e5, "−4·10⁵"), (-3e-3, "−3·10⁻³")],
)  # fmt: skip
def test_a_number_of_a_cell_is_short(value: float, text: str) -> None:
    assert compact(value) == text and len(text) <= 8


@pytest.mark.parametrize(
    ("low", "high", "sigma", "text"),
    [(21.1, 21.6, 0.12, "21.10 to 21.60"), (-1.0, 3.0, 1.02, "−1.0 to 3.0"),
     (-0.3, 120.0, 30.0, "0 to 120"), (40912.0, 43000.0, 2500.0, "40900 to 43000"),
     (1e-8, 3e-8, 5e-9, "1.00·10⁻⁸ to 3.00·10⁻⁸"),
     (2.0, 2.0, 0.0, "2.00 to 2.00")],
)  # fmt: skip
def test_an_interval_has_the_digits_that_its_sigma_leaves(
    low: float, high: float, sigma: float, text: str
) -> None:
    assert interval(low, high, sigma) == text


@pytest.mark.parametrize(
    ("share", "text"),
    [(0.0, "< 1 %"), (0.0099, "< 1 %"), (0.012, "1 %"), (0.65, "65 %"), (0.999, "99 %"),
     (1.0, "100 %")],
)  # fmt: skip
def test_only_what_is_whole_is_a_hundred_percent(share: float, text: str) -> None:
    assert percent(share) == text


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.42, "0.4 s"), (72.4, "72 s"), (270.0, "4.5 min"), (7560.0, "2.1 h")],
)
def test_a_duration_is_told_in_the_unit_that_suits_it(seconds: float, text: str) -> None:
    assert duration(seconds) == text


@pytest.mark.parametrize(
    ("size", "text"),
    [
        (0, "0 B"), (812, "812 B"), (999, "999 B"), (1000, "1.00 kB"), (1254, "1.25 kB"),
        (98_700_000, "98.7 MB"), (12e9, "12.0 GB"), (999_499, "999 kB"), (999_600, "1.00 MB"),
        (3.4e12, "3.40 TB"), (7e15, "7000 TB"),
    ],
)  # fmt: skip
def test_a_size_is_told_in_thousands_of_thousands(size: float, text: str) -> None:
    assert byte_size(size) == text


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.4, "0.4 s"), (40.0, "40 s"), (7200.0, "2.0 h"), (172_800.0, "2 days"), (3e7, "347 days")],
)
def test_an_age_is_told_in_days_from_two_on(seconds: float, text: str) -> None:
    assert age(seconds) == text


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("grain \x1b[31mσ\x07", r"grain \x1b[31mσ\x07"),
        ("\x9b2J", r"\x9b2J"),
        ("left‮right", r"left\u202eright"),
        ("half of a pair \udcc3", r"half of a pair \udcc3"),
        ("a\tb\nc · 1 µm", "a\tb\nc · 1 µm"),
    ],
)
def test_control_characters_are_shown_as_escapes(text: str, shown: str) -> None:
    assert printable(text) == shown
