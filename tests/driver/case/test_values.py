from __future__ import annotations

from typing import Any

import pytest
from pydantic import ValidationError

from driver.case.values import (
    Count,
    FileName,
    Frame,
    NonNegative,
    Number,
    Positive,
    Table,
    Vector,
)
from tests.driver.case.tables import refused


class Sample(Table):
    """A key of each kind."""

    number: Number = 0.0
    positive: Positive = 1.0
    non_negative: NonNegative = 0.0
    frame: Frame = 0
    count: Count = 1
    name: FileName = "a"
    vector: Vector = (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("number", -1e12), ("number", 3), ("positive", 1e-300), ("non_negative", 0), ("frame", 0),
        ("count", 1), ("name", "a b.tif"), ("vector", (1, -2.5, 3)),
    ],
)  # fmt: skip
def test_values_of_a_kind_are_taken_as_they_are(key: str, value: Any) -> None:
    assert getattr(Sample.model_validate({key: value}), key) == value


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("number", 1.1e12), ("number", -1.1e12), ("positive", 1e30), ("non_negative", 1e300),
        ("number", "3"), ("number", True), ("number", float("nan")), ("number", float("inf")),
        ("positive", 0.0), ("positive", -1.0), ("non_negative", -1e-300), ("frame", -1),
        ("frame", 1.0), ("count", 0), ("count", 2.0), ("count", True), ("name", ""),
        ("name", 5),
    ],
)  # fmt: skip
def test_what_is_no_value_of_a_kind_is_refused_and_not_converted(key: str, value: Any) -> None:
    assert refused(Sample, **{key: value})[0] == key


def test_a_vector_has_three_finite_numbers() -> None:
    assert refused(Sample, vector=(1.0, 2.0))[0] == "vector.2"
    assert refused(Sample, vector=(1.0, 2.0, 3.0, 4.0))[0] == "vector"
    assert refused(Sample, vector=(1.0, float("nan"), 3.0))[0] == "vector.1"


def test_a_table_knows_its_keys_alone_and_never_changes() -> None:
    assert refused(Sample, numbr=1.0) == ("numbr", "extra_forbidden")
    with pytest.raises(ValidationError, match="frozen"):
        Sample().number = 1.0
