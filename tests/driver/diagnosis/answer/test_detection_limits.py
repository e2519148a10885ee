from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from driver.diagnosis.answer.detection_limits import not_found, not_seen
from driver.diagnosis.answer.result_types import Round
from driver.diagnosis.statistics.score_test import Score
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


def round_of(lost: object = None, *refits: object) -> Round:
    return cast(Round, SimpleNamespace(lost=lost, refits=refits))


def seen(name: str = "shift") -> Score:
    cause: Any = SimpleNamespace(name=name, parameters=("shift",), unseen="")
    return cast(Score, SimpleNamespace(cause=cause, p=1e-3, visible=np.array([0.5])))


def test_of_a_cause_that_is_seen_and_was_not_added_it_is_said_why() -> None:
    one, other = seen(), seen("other")
    weak, likely = (
        SimpleNamespace(cause=s.cause, log_evidence=e) for s, e in ((one, 0.4), (other, 5))
    )
    begin = "seen here (p 0.001) and not added: "
    apart, near = (SimpleNamespace(along=other.cause, passed=passed) for passed in (False, True))
    for round_, why in (
        (round_of(apart), "the second mesh takes it away"),
        # The mean of near meshes has judged, and shows it.
        (round_of(near), "no more causes were added"),
        (round_of(None, weak), "its refit has a log evidence of +0.4, and 1 is wanted"),
        (round_of(), "no more causes were added"),
        (round_of(None, likely), "others were more likely"),
    ):
        assert not_found(one, round_, PARAMETERS) == begin + why
    assert (
        not_found(other, round_of(None, likely), PARAMETERS) == begin + "no more causes were added"
    )


def with_p(scored: Score, p: float) -> Score:
    return cast(Score, SimpleNamespace(cause=scored.cause, visible=scored.visible, p=p))


def test_of_a_cause_that_is_not_seen_it_is_said_from_where_on_it_would_be() -> None:
    quiet = with_p(of(shift=0.5), 0.3)
    assert not_found(quiet, round_of(), PARAMETERS) == not_seen(quiet, PARAMETERS)
