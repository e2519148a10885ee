from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from driver.diagnosis.score import Score
from driver.diagnosis.visible import not_seen
from solver_adapters.parameter import Parameter

PARAMETERS = {
    "shift": Parameter("shift", "µm", 0.0, 0.3),
    "ratio": Parameter("ratio", "", 1.0, 0.1, 0.3, 3.0, True),
}


def of(**visible: float) -> Score:
    found: Any = SimpleNamespace(
        cause=SimpleNamespace(parameters=tuple(visible), unseen="it is dark"),
        visible=np.array(list(visible.values())),
    )
    return cast(Score, found)


@pytest.mark.parametrize(
    ("scored", "said"),
    [
        (of(shift=0.5), "not seen here: it would have been seen from shift by 0.15 µm on"),
        (of(ratio=1.0), "not seen here: it would have been seen from ratio by a factor 1.11 on"),
        (of(shift=10.0), "undetectable here: it would be seen from shift by 3 µm on, 10.0 times"),
        (
            of(shift=np.inf),
            "undetectable here: of no size would these data show it, for it is",
        ),
        (of(shift=np.inf, ratio=2.0), "not seen here: it would have been seen from ratio by"),
    ],
)
def test_a_cause_that_was_not_found_is_said_with_what_would_have_been_seen(
    scored: Score, said: str
) -> None:
    assert not_seen(scored, PARAMETERS).startswith(said)
