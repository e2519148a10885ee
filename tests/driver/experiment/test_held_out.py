from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from driver.case.model import Case, CaseError, default_case
from driver.experiment.held_out import held_out_cycle
from driver.experiment.history import History


def history(*cycles: int) -> History:
    """A history with an image of each of these cycles."""
    rows = np.arange(len(cycles))
    instants = np.linspace(0.0, 100.0, len(cycles))
    return History(
        time=instants, stage=instants / 2, image_row=rows, force=np.ones(rows.size),
        turning=rows, cycle=np.array(cycles),
    )  # fmt: skip


def case(asked: Any, left_out: tuple[int, ...] = ()) -> Case:
    plain = default_case()
    return plain.model_copy(
        update={
            "diagnosis": plain.diagnosis.model_copy(update={"held_out_cycle": asked}),
            "loads": plain.loads.model_copy(update={"left_out": left_out}),
        }
    )


@pytest.mark.parametrize(("asked", "cycle"), [("last", 3), ("none", None), (1, 1), (3, 3)])
def test_the_cycle_that_is_asked_for_is_held_out(asked: Any, cycle: int | None) -> None:
    assert held_out_cycle(case(asked), history(1, 1, 2, 3, 3)) == cycle


@pytest.mark.parametrize("asked", ["last", "none", 1])
def test_of_one_cycle_nothing_can_be_held_out(asked: Any) -> None:
    assert held_out_cycle(case(asked), history(1, 1, 1)) is None


def test_a_cycle_that_there_is_not_is_refused() -> None:
    with pytest.raises(CaseError) as error:
        held_out_cycle(case(4), history(1, 2, 3))
    assert str(error.value).endswith(
        "diagnosis.held_out_cycle: found 4, expected one of the 3 cycle(s)"
    )


def test_a_cycle_without_a_load_that_counts_is_refused_and_with_one_is_not() -> None:
    test = history(1, 1, 2, 2)
    with pytest.raises(
        CaseError, match="loads.left_out: found all loads of cycle 2, which is held"
    ):
        held_out_cycle(case("last", (2, 3)), test)
    assert held_out_cycle(case("last", (3,)), test) == 2
    assert held_out_cycle(case("none", (2, 3)), test) is None
