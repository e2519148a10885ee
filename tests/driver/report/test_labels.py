from __future__ import annotations

import math

from driver.diagnosis.causes.causes import LIBRARY
from driver.diagnosis.causes.ebsd_flips import FLIPS
from driver.parameters.registry import declared_parameters
from driver.report.labels import (
    change,
    label,
    named,
    readable,
    reading_unit,
    short_label,
    smallest,
)
from driver.report.style import INDEXED


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


def test_beside_a_matrix_labels_are_short() -> None:
    assert short_label("elongation_3") == "ΔU_Y 3" and short_label("origin_X") == "origin X"
    assert max(len(short_label(name)) for name in declared_parameters(4) if "lambda" in name) <= 4


def test_parameters_in_a_text_are_written_as_elsewhere() -> None:
    text = named("tau0_112 and tau0: c hardly", ["tau0", "tau0_112", "c"])
    assert text == "τ₀ of {112} / τ₀ of {110} and τ₀: c hardly"
