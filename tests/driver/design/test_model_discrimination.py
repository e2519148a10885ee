from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest

from driver.design.forecast import Forecast
from driver.design.model_discrimination import Discrimination, advice, apart
from driver.diagnosis.statistics.score_test import SEEN_AT


def expected(cosine: float, seen: dict[str, float]) -> Forecast:
    causes = [
        SimpleNamespace(
            cause=SimpleNamespace(name=name), in_scales=scales,
            cosines={other: cosine for other in seen if other != name},
        )
        for name, scales in seen.items()
    ]  # fmt: skip
    return cast(Forecast, cast(Any, SimpleNamespace(causes=causes)))


def test_causes_are_apart_by_what_one_leaves_of_the_smaller_other() -> None:
    """Two scales of each are 18 and 9 σ; of 9 σ a cosine of 0.6 leaves 7.2 σ."""
    found = apart(expected(0.6, {"a": 0.5, "b": 1.0}), {"a": 2.0, "b": 2.0})
    assert found == pytest.approx(0.8 * 2.0 * SEEN_AT)
    assert apart(expected(1.0, {"a": 0.5, "b": 1.0}), {"a": 2.0, "b": 2.0}) == 0.0


def test_the_advice_is_the_change_that_parts_them_or_that_none_does() -> None:
    now, leg, hold = (
        Discrimination("", 0.3),
        Discrimination("a leg of compression", 6.2),
        Discrimination("holds", 0.4),
    )
    assert "a leg of compression would part them best: by 6.2 σ" in advice([now, leg, hold])
    assert advice([now, hold]).startswith("None of the usual changes")
