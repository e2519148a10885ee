from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np

from driver.diagnosis.refit_choice import to_refit
from driver.diagnosis.score import Score


def scored(p: float, evidence: float, angle: float = 0.0) -> Score:
    """A cause that does to the data what a unit vector at an angle in a plane says."""
    along = np.array([[np.cos(angle), np.sin(angle)]])
    return cast(
        Score,
        SimpleNamespace(p=p, log_evidence=evidence, directions=along, strengths=np.ones(1)),
    )


def test_a_cause_that_promises_as_much_as_the_seen_one_is_refitted_with_it() -> None:
    best, seen, near, far = (
        scored(*of) for of in ((0.015, 4.4), (0.004, 3.9), (0.05, 3.2), (0.3, 1.0))
    )
    assert to_refit([best, seen, near, far], 5) == [best, seen, near]
    assert to_refit([best, seen, near, far], 2) == [best, seen]
    assert to_refit([best, near, far], 5) == []  # where nothing is seen nothing is refitted


def test_a_cause_that_has_nothing_to_do_with_the_seen_one_is_not_refitted_with_it() -> None:
    seen, akin, strange = scored(0.004, 3.9), scored(0.05, 4.0, 0.9), scored(0.05, 4.1, 1.2)
    assert to_refit([strange, akin, seen], 5) == [akin, seen]


def test_close_rivals_of_the_best_are_refitted_however_many_they_are() -> None:
    tried = [scored(1e-9, evidence) for evidence in (40.0, 34, 33, 32, 31, 29, 12)]
    assert to_refit(tried, 2) == tried[:5]
    assert to_refit(tried, 6) == tried[:6]


def test_a_significant_cause_without_evidence_opens_the_door_for_no_other() -> None:
    best, near, odd = (scored(*of) for of in ((0.4, 1.6), (0.5, 1.2), (0.004, 0.01)))
    assert to_refit([best, near, odd], 5) == [odd]
