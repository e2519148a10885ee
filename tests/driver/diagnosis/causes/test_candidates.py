from __future__ import annotations

from driver.diagnosis.causes.candidates import causes_of, not_examined
from driver.diagnosis.causes.causes import LIBRARY, Cause
from driver.parameters.registry import declared_parameters

DECLARED = declared_parameters(5)
NAMES = [cause.name for cause in LIBRARY]


def test_what_is_fitted_or_unknown_or_unwanted_is_no_cause() -> None:
    every = tuple(DECLARED)
    assert causes_of(every, (), None) == LIBRARY
    fitted = [cause.name for cause in causes_of(every, ("load_gain", "K"), None)]
    assert set(NAMES) - set(fitted) == {"load_gain", "rate_sensitivity"}
    single = [name for name in every if not name.startswith("boundary_")]
    without = {cause.name for cause in causes_of(single, (), None)}
    assert set(NAMES) - without == {"boundary_position", "boundary_tilt", "boundary_bow"}
    wanted = causes_of(every, ("load_gain",), ("load_gain", "tilt_drift"))
    assert [cause.name for cause in wanted] == ["tilt_drift"]


def test_every_cause_is_tried_or_left_out_with_a_reason() -> None:
    every = set(DECLARED)
    specimen = {n for n in every if not n.startswith("boundary_")}
    solver = every - {"Q", "boundary_shift"}
    left = not_examined(specimen, solver, ("load_gain",), None)
    tried = causes_of(specimen & solver, ("load_gain",), None)
    assert {one.cause for one in left} | {cause.name for cause in tried} == set(NAMES)
    assert len(left) + len(tried) == len(NAMES)
    why = {one.cause: one.why for one in left}
    assert why["boundary_position"] == "the specimen has no shift of the boundary along Y"
    assert why["isotropic_hardening"] == "the solver cannot honour Q"
    assert why["load_gain"] == "error of the load gain is fitted in the baseline"
    only = not_examined(specimen, solver, (), ("load_gain", "boundary_bow"))
    assert [one.cause for one in only] == ["boundary_bow"]


def test_ones_own_causes_are_tried_whatever_is_wanted_of_the_library() -> None:
    own = Cause("mine", "material", ("load_offset", "tilt_drift"), "", "")
    tried = causes_of(tuple(DECLARED), (), ("load_gain",), (own,))
    assert [cause.name for cause in tried] == ["load_gain", "mine"]


def test_a_cause_whose_companion_nobody_can_honour_is_not_tried() -> None:
    every = set(DECLARED)
    own = Cause("mine", "material", ("load_offset",), "", "", companions=("fixed_pattern",))
    assert causes_of(every - {"fixed_pattern"}, (), (), (own,)) == ()
    (left,) = not_examined(every, every - {"fixed_pattern"}, (), (), (own,))
    assert left.why == "the solver cannot honour share of the flat pattern left"
