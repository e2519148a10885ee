from __future__ import annotations

import time
from dataclasses import replace
from io import StringIO
from pathlib import Path

import pytest
from rich.console import Console
from rich.table import Table

from driver.batch.jobs import Job
from driver.batch.progress import State, at_work, remaining, table
from tests.driver.batch.cases import job

LOG = """    0.2 s  all stages take about 45 s on free cores and 0.6 GB of memory
    0.3 s  mesh: started
    0.4 s  mesh: finished in 0.1 s
    0.5 s  identify: started
    9.1 s    iteration 2: χ_F    1.38  χ of images 1.065  step 66.2 σ
"""


def logged(made: Job, text: str) -> None:
    made.log.parent.mkdir(exist_ok=True)
    made.log.write_text(text, encoding="utf-8")


def printed(made: Table) -> str:
    console = Console(width=200, file=StringIO())
    console.print(made)
    assert isinstance(console.file, StringIO)
    return console.file.getvalue()


def test_stage_and_last_words_are_read_from_the_end_of_the_log(tmp_path: Path) -> None:
    made = job(tmp_path, seconds=40.0)
    assert at_work(made, 0.0) == State(made, "waiting")
    logged(made, "x" * 9000 + "\n" + LOG)
    state = at_work(made, 0.0)
    assert (state.status, state.stage, state.seconds) == ("running", "identify", 9.1)
    assert state.words == "iteration 2: χ_F    1.38  χ of images 1.065  step 66.2 σ"


def test_a_log_of_another_run_tells_nothing_of_this_one(tmp_path: Path) -> None:
    made = job(tmp_path, seconds=40.0)
    logged(made, LOG)
    assert at_work(made, time.time() + 60.0) == State(made, "waiting")


def test_what_is_left_follows_the_estimate_and_does_not_end_before_the_job(tmp_path: Path) -> None:
    made = job(tmp_path, seconds=40.0)
    assert State(made, "waiting").left == 40.0
    assert State(made, "running", 10.0).left == 30.0
    assert State(made, "running", 60.0).left == pytest.approx(30.0)
    assert State(made, "done", 60.0).left == 0.0


def test_all_jobs_take_as_long_as_all_of_them_side_by_side_or_the_longest(tmp_path: Path) -> None:
    states = [State(job(tmp_path, name, seconds=40.0), "waiting") for name in "abcd"]
    assert remaining(states, 2) == 80.0 and remaining(states, 4) == 40.0
    longest = State(job(tmp_path, "e", seconds=500.0), "waiting")
    assert remaining([*states, longest], 4) == 500.0


def test_the_table_has_a_line_for_each_job_those_at_work_first(tmp_path: Path) -> None:
    done, failed, busy = (
        job(tmp_path, name, seconds=40.0) for name in ("first", "second", "third")
    )
    logged(busy, LOG)
    states = [
        State(done, "done", 50.0),
        State(failed, "failed", 3.0, words="c.toml: found 1, expected 2\nmore"),
        at_work(busy, 0.0),
        *(State(job(tmp_path, f"n{k}"), "waiting") for k in range(40)),
    ]
    text = printed(table(states, 2))
    assert "1 running, 1 failed, 40 waiting, 1 done; about" in text
    assert text.index("third") < text.index("second") < text.index("n0")
    assert "found 1, expected 2" in text and "more" in text and "identify" in text
    assert "13 more" in text and "n39" not in text


def test_a_long_last_line_is_cut(tmp_path: Path) -> None:
    state = replace(State(job(tmp_path, seconds=40.0), "running", 1.0), words="w" * 200)
    assert "w" * 59 + "…" in printed(table([state], 1))
