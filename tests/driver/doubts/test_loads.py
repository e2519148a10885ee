"""What a check says of loads that no specimen in tension has."""

from __future__ import annotations

import numpy as np
import pytest

from driver.case.history import ForceColumn, HistoryColumns
from driver.case.model import default_case
from driver.doubts.loads import strange_loads
from driver.experiment.history import History

STAGE = np.array([0.0, 10.0, 20.0, 10.0, 0.0])
LOADS = np.array([0.0, 900.0, 1000.0, 100.0, -600.0])  # µN
HISTORY = History(
    time=np.arange(5.0),
    stage=STAGE,
    image_row=np.arange(5),
    force=LOADS,
    turning=np.array([0, 2, 4]),
    cycle=np.ones(5, dtype=np.int64),
)


@pytest.mark.parametrize(
    ("loads", "found"),
    [
        (0.0 * LOADS, "found loads within 0 µN at the specimen, expected more than their noise"),
        (-LOADS, "found loads that fall in the first loading, expected tension positive"),
    ],
)
def test_loads_without_a_change_or_of_a_wrong_sign_are_warned_of(
    loads: np.ndarray, found: str
) -> None:
    (finding,) = strange_loads(default_case(), HISTORY, loads)
    assert finding.level == "warning"
    assert finding.message.startswith(f"history.csv: force_N: {found}")


def test_loads_are_named_by_their_column() -> None:
    columns = HistoryColumns(force=ForceColumn(name="Load [kN]", unit="kN"))
    history = default_case().history.model_copy(update={"columns": columns})
    case = default_case().model_copy(update={"history": history})
    (finding,) = strange_loads(case, HISTORY, -LOADS)
    assert finding.message.startswith("history.csv: Load [kN]: found loads")


def test_a_test_in_tension_with_some_compression_is_not_warned_of() -> None:
    assert not list(strange_loads(default_case(), HISTORY, LOADS))
    # A stage that counts backwards pulls all the same.
    back = History(**{**vars(HISTORY), "stage": -STAGE})
    assert not list(strange_loads(default_case(), back, LOADS))


def test_loads_that_the_case_leaves_out_are_not_warned_of() -> None:
    loads, case = LOADS.copy(), default_case()
    loads[2] = -1e6
    (finding,) = strange_loads(case, HISTORY, loads)
    assert "tension positive" in finding.message
    left_out = case.loads.model_copy(update={"left_out": (2,)})
    assert not list(strange_loads(case.model_copy(update={"loads": left_out}), HISTORY, loads))
