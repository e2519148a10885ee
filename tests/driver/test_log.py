from __future__ import annotations

from driver.log import Log, passing_of, seldom


def test_lines_stay_and_words_for_the_moment_go_elsewhere() -> None:
    lines: list[str] = []
    words: list[str] = []
    log = Log(lines.append, words.append)
    log("stage A")
    passing_of(log)("at 3 s")
    assert (lines, words) == (["stage A"], ["at 3 s"])


def test_a_log_of_lines_alone_takes_no_words_for_the_moment() -> None:
    lines: list[str] = []
    passing_of(lines.append)("at 3 s")
    assert lines == []


def test_a_log_tells_of_a_long_simulation_only_now_and_then() -> None:
    told: list[str] = []
    now = 100.0
    tell = seldom(told.append, every=30.0, clock=lambda: now)
    for now in (101.0, 129.9, 130.0, 131.0, 159.9, 161.0):  # noqa: B007
        tell(f"at {now:g}")
    assert told == ["at 130", "at 161"]
