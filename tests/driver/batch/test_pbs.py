"""Campaigns on a real PBS of one node: its jobs are their workers."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import time
from pathlib import Path
from typing import Any

import psutil
import pytest

from tests.driver.batch.cases import agreed, rows, write_small_case
from tests.driver.batch.queue_commands import SOON_SILENT, command, left
from tests.driver.batch.seen_calls import SeenCalls
from tests.support.pbs import asked_of, queued, unusable

pytestmark = [pytest.mark.slow, pytest.mark.skipif(bool(unusable()), reason=unusable())]
# PBS gives jobs nothing of the environment that they are handed in from.
DIRECTIVES = '"-v PYTHONPATH"'
STUDY = f"""
until = "mesh"
[[study]]
case = "good/case.toml"
values."specimen.length_um" = [9.0, 10.0, 11.0]
[execution]
threads = 1
[cluster]
system = "pbs"
walltime = "00:10:00"
job_extra_directives = [{DIRECTIVES}]
"""


def campaign(folder: Path, *changes: tuple[str, str]) -> tuple[Path, dict[str, str]]:
    """Write a campaign that differs from the study, and return the variables of its command."""
    write_small_case(folder / "good")
    file, text = folder / "campaign.toml", STUDY
    for old, new in changes:
        text = text.replace(old, new)
    file.write_text(text, encoding="utf-8")
    return file, os.environ | agreed(file)


def test_cases_run_in_jobs_of_pbs_and_one_whose_job_is_deleted_goes_on_in_another(
    tmp_path: Path,
) -> None:
    """As at the end of the walltime; there is one worker at a time, so that it is replaced."""
    seen: list[dict[str, Any]] = []

    def delete(process: psutil.Process, before: int) -> None:
        if not before:
            process.suspend()  # it is in the middle of its work until PBS ends it
            job = process.environ()["PBS_JOBID"]
            seen.append(asked_of(job))
            subprocess.run(["qdel", job], check=True)

    file, variables = campaign(
        tmp_path,
        (", 11.0]", "]"),
        ("threads = 1", "threads = 2\njobs = 1"),
        ("[cluster]", '[cluster]\naccount = "steel"\nmemory_GB = 1.5'),
    )
    with SeenCalls(file, delete) as calls:
        run = command(file, variables)
        said, complaints = run.communicate(timeout=300)
    assert (complaints, run.returncode) == ("", 0), said
    assert "2 cases, 1 at a time on 2 core(s) on workers of pbs" in said
    assert {row["status"] for row in rows(file).values()} == {"done"}
    (first, again), (other,) = calls.of_case.values()
    assert first[:1].isdecimal() and first != again == other
    (job,) = seen
    assert (job["Job_Name"], job["Account_Name"]) == ("prismid", "steel")
    resources = {key: job["Resource_List"][key] for key in ("select", "walltime")}
    assert resources == {"select": "1:ncpus=2:mem=1431MB", "walltime": "00:10:00"}
    assert left(file, queued) == []
    kept = {path.name for path in (file.with_suffix(".batch") / "workers").iterdir()}
    assert kept == {f"{job}.{kind}" for job in (first, again) for kind in ("OU", "ER")}  # no keys


def test_ctrl_c_takes_back_all_jobs_those_that_wait_too(tmp_path: Path) -> None:
    run: list[subprocess.Popen[str]] = []

    def stop(process: psutil.Process, before: int) -> None:
        process.suspend()
        # One job has the whole node; the others wait.
        while len(queued()) < 3:
            time.sleep(0.1)
        process.resume()
        os.killpg(run[0].pid, signal.SIGINT)

    file, variables = campaign(tmp_path, (DIRECTIVES, f'{DIRECTIVES}, "-l place=excl"'))
    with SeenCalls(file, stop):
        run.append(command(file, variables))
        _, complaints = run[0].communicate(timeout=300)
    assert run[0].returncode == 130
    assert complaints == "prismid: stopped; finished stages are kept, run again to go on\n"
    assert left(file, queued) == []


def test_what_pbs_refuses_is_told_in_its_words(tmp_path: Path) -> None:
    file, variables = campaign(tmp_path, ("[cluster]", '[cluster]\nqueue = "nowhere"'))
    run = command(file, variables)
    _, complaints = run.communicate(timeout=300)
    assert run.returncode == 1 and left(file, queued) == []
    assert complaints == (
        f"prismid: {file}: cluster: found “qsub: Unknown queue”, expected keys that it takes\n"
    )


def test_jobs_that_bring_no_worker_are_told(tmp_path: Path) -> None:
    """PBS brings what they said when they have ended."""
    prologue = '[cluster]\njob_script_prologue = ["exit 1"]'
    file, variables = campaign(tmp_path, ("[cluster]", prologue))
    run = command(file, variables, SOON_SILENT)
    _, complaints = run.communicate(timeout=300)
    assert run.returncode == 1 and left(file, queued) == []
    said = r"cluster: found jobs \d+, \d+, \d+ that have begun and brought no worker \(what they"
    assert re.match(rf"prismid: {re.escape(str(file))}: {said} said is in .*workers", complaints)
    assert complaints.count("\n") == 1
