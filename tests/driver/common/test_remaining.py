"""What is left of a run is renewed by what its simulations and stages have taken."""

from __future__ import annotations

import pytest

from driver.common import remaining as module
from driver.common.remaining import Remaining, at_work, foretold, left_of_run, simulated


def run() -> Remaining:
    return Remaining(
        {"measure": 20.0, "identify": 100.0, "diagnose": 300.0}, ("identify", "diagnose")
    )


def test_what_was_foreseen_is_counted_down() -> None:
    left = run()
    assert left.seconds(0.0) == 420.0
    left.begin("measure", 0.0)
    assert left.seconds(5.0) == 415.0
    left.end(30.0)
    assert left.seconds(30.0) == 400.0  # of another kind than simulations


def test_simulations_that_take_longer_renew_what_all_of_them_take() -> None:
    left = run()
    left.foreseen.pop("measure")
    left.begin("identify", 0.0)
    # A single step tells of its start, and the first whole one has compiled.
    left.simulated(1.0, 0.01)
    for seconds in (50.0, 6.0, 6.0):
        left.simulated(seconds, 2.0)
    assert left.factor == 3.0 and left.seconds(62.0) == 300.0 - 62.0 + 900.0


def test_a_stage_that_has_ended_counts_more_than_its_simulations() -> None:
    left = run()
    left.foreseen.pop("measure")
    left.begin("identify", 0.0)
    left.simulated(6.0, 2.0)
    left.end(50.0)
    assert left.seconds(50.0) == 150.0


def test_a_stage_that_overruns_is_never_said_to_be_at_its_end() -> None:
    left = Remaining({"identify": 100.0}, ("identify",))
    left.begin("identify", 0.0)
    assert [left.seconds(now) for now in (90.0, 100.0, 1000.0)] == [18.0, 20.0, 200.0]


def test_it_is_told_of_the_run_alone_and_not_of_its_last_seconds(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock = iter((0.0, 0.0, 100.0, 100.0, 100.0, 100.0, 500.0, 500.0, 500.0))
    monkeypatch.setattr(module, "monotonic", lambda: next(clock))
    assert left_of_run() == ""
    with foretold({"identify": 200.0, "diagnose": 100.0}, ("identify", "diagnose")):
        assert left_of_run() == "about 5.0 min left of the run"
        with at_work("identify"):
            assert left_of_run() == "about 3.3 min left of the run"
            simulated(8.0, 2.0)
            assert left_of_run() == "about 18.3 min left of the run"
        assert left_of_run() != ""
        with at_work("diagnose"):
            pass
        assert left_of_run() == ""
    assert left_of_run() == ""
