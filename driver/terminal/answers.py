"""Answers for other programs: one JSON object on standard output, as `docs/terminal.md` has it."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stdout
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from driver.doubts.finding import Finding
    from driver.status.command import CaseStatus
    from driver.terminal.endings import Ending

Answer = Mapping[str, Any]


@contextmanager
def answered(as_json: bool) -> Iterator[Callable[[Answer], None]]:
    """Return what takes the answer of a verb; all that is told inside goes to standard error.

    Args:
        as_json: whether one is asked for; else it is left away, and nothing is redirected.
    """
    if not as_json:
        yield lambda answer: None
        return
    given: list[Answer] = []
    try:
        with redirect_stdout(sys.stderr):
            yield given.append
    finally:
        for answer in given:
            print(json.dumps({"prismid": version("prismid"), **answer}))


def answer_of_check(case: Path, findings: Sequence[Finding]) -> Answer:
    """Return what a check has found."""
    good = not any(finding.level == "error" for finding in findings)
    return {"case": str(case), "good": good, "findings": [asdict(each) for each in findings]}


def answer_of_run(endings: Sequence[tuple[Path, Path, Ending]]) -> Answer:
    """Return how the runs of cases have ended.

    Args:
        endings: of each case its file or folder, the folder of its results, and how it has ended.
    """
    cases = [
        {"case": str(case), "results": str(results), **asdict(ending)}
        for case, results, ending in endings
    ]
    return {"cases": cases}


def answer_of_status(status: CaseStatus) -> Answer:
    """Return how far a case is."""
    return asdict(status) | {"case": str(status.case), "results": str(status.results)}
