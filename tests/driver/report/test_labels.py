from __future__ import annotations

import math

from driver.diagnosis.causes.all_causes import EVERY
from driver.report.labels import cause_label, change, reading_unit, smallest


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


def test_a_cause_is_written_by_its_label_and_one_of_the_users_own_by_the_words_of_its_name() -> (
    None
):
    assert [cause_label(cause.name) for cause in EVERY] == [cause.title for cause in EVERY]
    assert cause_label("twisted_grip") == "twisted grip"
