"""Shares of a few dozen trials, counted once more by their lines."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from benchmarks.blind_figures import print_figures, show_share
from benchmarks.blind_store import read

LINES = read(Path(__file__).with_name("trials.jsonl.xz"))


@pytest.fixture
def printed(capsys: pytest.CaptureFixture[str]) -> str:
    print_figures(LINES)
    return capsys.readouterr().out


def test_each_trial_counts_once(printed: str) -> None:
    (number,) = re.findall(r"^trials = (\d+)", printed, re.MULTILINE)
    assert int(number) == len({line["trial"]["name"] for line in LINES}) == len(LINES)


def test_shares_are_those_of_the_lines_with_their_bounds(printed: str) -> None:
    shares = {
        name: (float(share), int(number))
        for name, share, number in re.findall(
            r"^(.+) \[%\] = ([\d.]+) \[.+\] of (\d+) \(", printed, re.MULTILINE
        )
    }
    nulls = [line for line in LINES if line["trial"]["kind"] == "null"]
    named = [line for line in nulls if line["said"]]
    share, number = shares["null: something named"]
    assert number == len(nulls) > 10
    assert share == pytest.approx(100 * len(named) / len(nulls), abs=0.05)
    outside = [line for line in LINES if line["trial"]["kind"] == "outside"]
    # A soft slice has a cause by now.
    outside = [line for line in outside if line["trial"]["truths"] != ["soft_slice"]]
    large = [line for line in outside if line["misfit"] >= 8.0]
    unexplained = [line for line in large if line["verdict"] == "unexplained"]
    share, number = shares["outside the library, misfit >= 8 sigma: unexplained"]
    assert number == len(large) > 3
    assert share == pytest.approx(100 * len(unexplained) / len(large), abs=0.05)


def test_a_goal_is_met_when_its_bound_is(capsys: pytest.CaptureFixture[str]) -> None:
    for hits in (97 * [True] + 3 * [False], 100 * [True]):
        show_share("seen [%]", hits, ">= 96")
    first, second = capsys.readouterr().out.splitlines()
    assert "97.0 [91.5, 99.0] of 100 (goal: >= 96: missed)" in first
    assert "100.0 [96.3, 100.0] of 100 (goal: >= 96: met)" in second
