"""What counts as the same number."""

from __future__ import annotations

import numpy as np
import pytest

from driver.verify.comparison import TOLERANCE, compared


def array(*numbers: float) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    return np.array(numbers)


def test_a_result_agrees_with_itself_with_nan_and_infinity_in_it() -> None:
    values = {"a": array(1.0, np.nan, np.inf, -0.0), "b": np.array([b"x", b"y"]), "c": np.array(3)}
    found = compared(values, {name: value.copy() for name, value in values.items()})
    assert (found.count, found.same, found.largest, found.differences) == (7, 7, 0.0, ())
    assert found.agrees(to_the_last_digit=True)


def test_the_last_digit_is_found_and_named_and_another_machine_may_have_it() -> None:
    stored, computed = array(1.0, 2.0, 3.0), array(1.0, np.nextafter(2.0, 3.0), 3.0)
    found = compared({"load": stored}, {"load": computed})
    (only,) = found.differences
    assert (only.name, only.stored, only.computed) == ("load[1]", "2.0", "2.0000000000000004")
    assert only.size == pytest.approx(np.spacing(2.0) / 3.0) and found.same == 2
    assert not found.agrees(to_the_last_digit=True) and found.agrees(to_the_last_digit=False)


@pytest.mark.parametrize(("times", "agrees"), [(0.99, True), (1.01, False)])
def test_another_machine_may_be_off_by_the_tolerance_of_the_largest_number(
    times: float, agrees: bool
) -> None:
    stored = array(1e-9, 400.0)
    found = compared({"x": stored}, {"x": stored + array(times * TOLERANCE * 400.0, 0.0)})
    assert found.agrees(to_the_last_digit=False) is agrees


def test_a_rounded_table_may_be_off_by_its_last_place_on_another_machine() -> None:
    stored, computed = {"x": array(1.23456, 100.0)}, {"x": array(1.23457, 100.001)}
    assert compared(stored, computed, rounding=1e-5).agrees(False)
    assert not compared(stored, computed).agrees(False)


@pytest.mark.parametrize(
    ("stored", "computed"),
    [
        (np.array(3), np.array(4)),
        (np.array([True]), np.array([False])),
        (array(1.0), array(np.nan)),
        (array(np.inf), array(1.0)),
        (array(1.0, 2.0), array(1.0)),
        (array(1.0), np.array(["1.0"])),
        (np.array("named"), np.array("one of this set")),
    ],
)
def test_counts_shapes_kinds_and_words_agree_or_do_not(
    stored: np.ndarray[tuple[int, ...], np.dtype[np.generic]],
    computed: np.ndarray[tuple[int, ...], np.dtype[np.generic]],
) -> None:
    found = compared({"x": stored}, {"x": computed})
    assert len(found.differences) == 1 and found.largest == np.inf
    assert not found.agrees(to_the_last_digit=False)


def test_an_array_that_only_one_of_both_holds_is_named() -> None:
    found = compared({"old": array(1.0)}, {"new": np.array(["a", "b"])})
    told = {each.name: (each.stored, each.computed) for each in found.differences}
    assert told == {"old": ("1 numbers", "nothing"), "new": ("nothing", "2 texts")}


def test_numbers_in_a_text_are_rounded_for_reading_and_may_differ_on_another_machine() -> None:
    found = compared({"text": np.array("3.1 σ off")}, {"text": np.array("3.2 σ off")})
    assert not found.agrees(to_the_last_digit=True) and found.agrees(to_the_last_digit=False)
