from __future__ import annotations

import logging

import pytest

from driver.common.progress import PASSING, collected_lines, progress_to, seldom, tenths
from solver_adapters.interface import Progress

logger = logging.getLogger("driver.somewhere.below")


def test_lines_stay_and_words_for_the_moment_go_elsewhere() -> None:
    lines: list[str] = []
    words: list[str] = []
    with progress_to(lines.append, words.append):
        logger.info("stage A")
        logger.log(PASSING, "at 3 s")
        logger.debug("nobody asked")
    assert (lines, words) == (["stage A"], ["at 3 s"])


def test_who_takes_lines_alone_gets_no_words_for_the_moment() -> None:
    lines: list[str] = []
    with progress_to(lines.append):
        logger.log(PASSING, "at 3 s")
    assert lines == []


def test_nothing_is_told_after_the_end_and_the_level_is_that_of_before() -> None:
    lines: list[str] = []
    driver = logging.getLogger("driver")
    before = driver.level, list(driver.handlers)
    with progress_to(lines.append):
        pass
    logger.info("late")
    assert lines == [] and (driver.level, list(driver.handlers)) == before


class Log(logging.Handler):
    """A handler of a program of one's own, above that of prismid."""

    def __init__(self) -> None:
        super().__init__()
        self.messages: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.messages.append(record.getMessage())


@pytest.mark.parametrize(
    ("level", "heard"), [("WARNING", []), ("INFO", ["stage A"]), ("DEBUG", ["stage A", "at 3 s"])]
)
def test_the_log_of_a_program_is_told_what_it_asks_for_and_no_more(
    level: str, heard: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    root, log = logging.getLogger(), Log()
    monkeypatch.setattr(root, "handlers", [log])
    monkeypatch.setattr(root, "level", logging.getLevelName(level))
    root.manager._clear_cache()  # type: ignore[attr-defined]
    lines: list[str] = []
    with progress_to(lines.append), progress_to(lines.append):
        logger.info("stage A")
        logger.log(PASSING, "at 3 s")
    assert (log.messages, lines) == (heard, ["stage A"] * 2)


def test_progress_of_two_threads_may_end_in_any_order() -> None:
    driver = logging.getLogger("driver")
    before = driver.level, driver.propagate, list(driver.handlers)
    lines: list[str] = []
    first, second = progress_to(lambda line: None), progress_to(lines.append)
    first.__enter__()
    second.__enter__()
    first.__exit__(None, None, None)
    logger.info("of the second")
    second.__exit__(None, None, None)
    assert lines == ["of the second"]
    assert (driver.level, driver.propagate, list(driver.handlers)) == before


def test_lines_of_a_job_are_collected_and_its_words_pass() -> None:
    lines: list[str] = []
    words: list[str] = []
    with progress_to(lines.append, words.append):
        with collected_lines() as own:
            logger.info("of a job")
            logger.log(PASSING, "at 3 s")
            with collected_lines() as inner:
                logger.info("of a job of the job")
                logger.log(PASSING, "at 4 s")
        logger.info("after it")
    assert (own, inner, lines) == (["of a job"], ["of a job of the job"], ["after it"])
    assert words == ["at 3 s", "at 4 s"]


def test_lines_of_a_job_are_collected_where_nobody_listens() -> None:
    with collected_lines() as own:
        logger.info("of a job")
    assert own == ["of a job"]


def test_a_percent_sign_stands_as_it_is() -> None:
    lines: list[str] = []
    with progress_to(lines.append):
        logger.info("50 % of %s pixels")
    assert lines == ["50 % of %s pixels"]


def test_each_tenth_of_a_simulation_is_told_once() -> None:
    lines: list[str] = []
    tell = tenths("  truth: ")
    with progress_to(lines.append):
        for time in (1.0, 12.0, 13.0, 35.0):
            tell(Progress(time, 100.0, 1, 1, 0))
    assert lines == ["  truth: 10 %", "  truth: 30 %"]


def test_a_log_tells_of_a_long_simulation_only_now_and_then() -> None:
    told: list[str] = []
    instants = (100.0, 101.0, 129.9, 130.0, 131.0, 159.9, 161.0)
    reading = {"at": instants[0]}
    tell = seldom(told.append, every=30.0, clock=lambda: reading["at"])
    for instant in instants[1:]:
        reading["at"] = instant
        tell(f"at {instant:g}")
    assert told == ["at 130", "at 161"]
