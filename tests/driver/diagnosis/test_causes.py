from __future__ import annotations

import pytest

from driver.diagnosis.causes import LIBRARY, NUMERICS, Cause
from driver.model import declared_parameters

DECLARED = declared_parameters(5)
NAMES = [cause.name for cause in LIBRARY]


@pytest.mark.parametrize("cause", LIBRARY, ids=NAMES)
def test_a_cause_names_parameters_of_the_general_model(cause: Cause) -> None:
    named = (*cause.parameters, *cause.companions)
    assert cause.parameters and set(named) <= set(DECLARED)
    assert len(set(named)) == len(named)
    assert cause.sentence and cause.check and not cause.sentence.endswith(".")
    assert not cause.bends or len(cause.parameters) == 1
    if cause.one_sided:
        (name,) = cause.parameters
        assert DECLARED[name].lower == DECLARED[name].null


def test_names_are_unique_and_every_category_is_there() -> None:
    assert len(set(NAMES)) == len(NAMES) and NUMERICS.name not in NAMES
    assert {cause.category for cause in (*LIBRARY, NUMERICS)} == {
        "material", "microstructure", "boundary", "instrument", "numerics",
    }  # fmt: skip


def test_no_two_causes_share_a_parameter() -> None:
    named = [name for cause in LIBRARY for name in cause.parameters]
    assert len(set(named)) == len(named)
