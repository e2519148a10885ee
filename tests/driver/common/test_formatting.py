import math

import pytest

from driver.common.formatting import (
    change,
    chi,
    compact,
    duration,
    interval,
    label,
    named,
    number,
    percent,
    probability,
    readable,
    reading_unit,
    short_label,
    signed,
    smallest,
    with_sigma,
)
from driver.diagnosis.causes.causes import LIBRARY
from driver.diagnosis.causes.ebsd_flips import FLIPS
from driver.parameters.registry import declared_parameters
from driver.report.style import INDEXED


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


def test_parameters_are_read_in_the_units_of_the_workshop() -> None:
    assert change("rotation_grain1_x", "rad", math.radians(2.0), False) == "+2.00°"
    assert smallest("rotation_grain1_x", "rad", math.radians(0.5), False) == "0.50°"
    assert reading_unit("elongation_3", "µm") == (1e3, "nm")
    assert reading_unit("tilt_drift", "") == (1e3, "mrad")
    assert reading_unit("boundary_shift", "µm") == (1.0, "µm")
    assert change("load_gain", "", 0.031, False) == "+3.10 %"


def test_a_logarithm_is_read_as_a_change_in_percent() -> None:
    assert change("tau0_grain2", "", math.log(1.15), True) == "+15.0 %"
    assert smallest("K", "MPa·s^(1/n)", math.log(1.02), True) == "2.0 %"
    assert smallest("K", "MPa·s^(1/n)", 40.0, True) == "not visible below a factor of 3"
    assert smallest("K", "MPa·s^(1/n)", None, True) == "not visible"


def test_every_parameter_that_can_be_shown_has_a_label_without_underscores() -> None:
    labels = {name: label(name) for name in declared_parameters(4)}
    assert not [name for name, text in labels.items() if "_" in INDEXED.sub("", text)]
    assert len(set(labels.values())) == len(labels)


def test_names_of_causes_in_a_text_become_words() -> None:
    names = [cause.name for cause in (*LIBRARY, *FLIPS)]
    text = readable("Check load_gain; check tilt_drift and boundary_tilt.", names)
    assert text == "Check load gain; check tilt drift and tilt of the grain boundary."


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


def test_beside_a_matrix_labels_are_short() -> None:
    assert short_label("elongation_3") == "ΔU_Y 3" and short_label("origin_X") == "origin X"
    assert max(len(short_label(name)) for name in declared_parameters(4) if "lambda" in name) <= 4


def test_parameters_in_a_text_are_written_as_elsewhere() -> None:
    text = named("tau0_112 and tau0: c hardly", ["tau0", "tau0_112", "c"])
    assert text == "τ₀ of {112} / τ₀ of {110} and τ₀: c hardly"
