from __future__ import annotations

from driver.common.progress import LiveLog, passing_of, seldom


def test_lines_stay_and_words_for_the_moment_go_elsewhere() -> None:
    lines: list[str] = []
    words: list[str] = []
    log = LiveLog(lines.append, words.append)
    log("stage A")
    passing_of(log)("at 3 s")
    assert (lines, words) == (["stage A"], ["at 3 s"])


def test_a_log_of_lines_alone_takes_no_words_for_the_moment() -> None:
    lines: list[str] = []
    passing_of(lines.append)("at 3 s")
    assert lines == []


def test_a_log_tells_of_a_long_simulation_only_now_and_then() -> None:
    told: list[str] = []
    instants = (100.0, 101.0, 129.9, 130.0, 131.0, 159.9, 161.0)
    reading = {"at": instants[0]}
    tell = seldom(told.append, every=30.0, clock=lambda: reading["at"])
    for instant in instants[1:]:
        reading["at"] = instant
        tell(f"at {instant:g}")
    assert told == ["at 130", "at 161"]
