"""Campaigns on a real Slurm of one node and of two: its jobs are their workers."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import time
from collections.abc import Iterator, Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path

import psutil
import pytest

from solver_adapters.kernels import PACKAGES
from tests.driver.batch.cases import agreed, rows, write_small_case
from tests.driver.batch.queue_commands import SOON_SILENT, SOON_TOLD, command, left
from tests.driver.batch.seen_calls import SeenCalls
from tests.support.slurm import missing, slurm

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        bool(missing()), reason=f"no {', '.join(missing())} here: Debian's slurm-wlm and munge"
    ),
]
STUDY = """
until = "mesh"
[[study]]
case = "good/case.toml"
values."specimen.length_um" = [9.0, 10.0, 11.0]
[cluster]
system = "slurm"
walltime = "00:10:00"
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    write_small_case(tmp_path / "good")
    made = tmp_path / "campaign.toml"
    made.write_text(STUDY, encoding="utf-8")
    return made


@pytest.fixture(scope="module")
def variables() -> Iterator[dict[str, str]]:
    """How the commands of Slurm are found."""
    with slurm() as found:
        yield {**os.environ, **found, "PYTHONPATH": str(PACKAGES)}


def queued(variables: Mapping[str, str]) -> list[str]:
    told = subprocess.run(
        ["squeue", "--noheader", "--format=%i %T"], env=variables, capture_output=True, text=True,
        check=True,
    )  # fmt: skip
    return told.stdout.splitlines()


def test_cases_run_in_jobs_of_slurm_and_one_whose_job_is_cancelled_goes_on_in_another(
    file: Path, variables: dict[str, str]
) -> None:
    """As at the end of the walltime; there is one worker at a time, so that it is replaced."""

    def cancel(process: psutil.Process, before: int) -> None:
        if not before:
            process.suspend()  # it is in the middle of its work until Slurm ends it
            job = process.environ()["SLURM_JOB_ID"]
            subprocess.run(["scancel", job], env=variables, check=True)

    file.write_text(STUDY.replace(", 11.0]", "]") + "[execution]\njobs = 1\n", encoding="utf-8")
    with SeenCalls(file, cancel) as calls:
        run = command(file, variables)
        said, complaints = run.communicate(timeout=300)
    assert (complaints, run.returncode) == ("", 0), said
    assert "2 cases, 1 at a time on 1 core(s) on workers of slurm" in said
    assert {row["status"] for row in rows(file).values()} == {"done"}
    (first, again), (other,) = calls.of_case.values()
    assert first.isdecimal() and first != again == other
    assert left(file, partial(queued, variables)) == []
    kept = {path.suffix for path in (file.with_suffix(".batch") / "workers").iterdir()}
    assert kept == {".out", ".err"}  # no keys of the scheduler


def test_a_case_whose_node_is_lost_goes_on_on_another_one(file: Path) -> None:
    """Its daemon and all that it runs end at once, as without power, and do not come back."""
    seen: list[str] = []

    def cut_off(process: psutil.Process, before: int) -> None:
        of_job = process.environ()
        seen.append(of_job["SLURMD_NODENAME"])
        if not before:
            process.suspend()
            for one in psutil.process_iter():
                with suppress(psutil.Error):
                    if _is_on(one, seen[0], of_job["SLURM_CONF"]):
                        one.kill()

    file.write_text(STUDY + "[execution]\njobs = 2\n", encoding="utf-8")
    with slurm(cores=1, nodes=2, silence=20) as found:
        variables = {**os.environ, **found, "PYTHONPATH": str(PACKAGES)}
        with SeenCalls(file, cut_off) as calls:
            run = command(file, variables)
            said, complaints = run.communicate(timeout=300)
        assert (complaints, run.returncode) == ("", 0), said
        assert left(file, partial(queued, variables)) == []
    assert {row["status"] for row in rows(file).values()} == {"done"}
    lost, *others = seen
    assert set(others) == {"node1", "node2"} - {lost}
    assert sorted(len(jobs) for jobs in calls.of_case.values()) == [1, 1, 2]


def _is_on(process: psutil.Process, node: str, conf: str) -> bool:
    """Whether a process is the daemon of a node of the Slurm of this file, or runs by it."""
    named = process.environ()
    daemon = process.cmdline()[-2:] == ["-N", node]
    return named.get("SLURM_CONF") == conf and (daemon or named.get("SLURMD_NODENAME") == node)


def test_ctrl_c_takes_back_all_jobs_those_that_wait_too(
    file: Path, variables: dict[str, str]
) -> None:
    run: list[subprocess.Popen[str]] = []

    def stop(process: psutil.Process, before: int) -> None:
        process.suspend()
        # One job has the whole node; the others wait.
        while len(queued(variables)) < 3:
            time.sleep(0.1)
        process.resume()
        os.killpg(run[0].pid, signal.SIGINT)

    file.write_text(STUDY + 'job_extra_directives = ["--exclusive"]\n', encoding="utf-8")
    variables = variables | agreed(file)
    with SeenCalls(file, stop):
        run.append(command(file, variables))
        _, complaints = run[0].communicate(timeout=300)
    assert run[0].returncode == 130
    assert complaints == "prismid: stopped; finished stages are kept, run again to go on\n"
    assert left(file, partial(queued, variables)) == []


def test_a_case_that_has_lost_its_workers_is_told_with_the_folder_of_what_they_said(
    file: Path, variables: dict[str, str]
) -> None:
    """They may well have died of something else than want of memory or of time."""
    once = {"DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "0"}
    file.write_text(STUDY.replace("9.0, 10.0, ", ""), encoding="utf-8")
    with SeenCalls(file, lambda process, before: psutil.Process(process.ppid()).kill()):
        run = command(file, variables | once)
        run.communicate(timeout=300)
    assert run.returncode == 1 and left(file, partial(queued, variables)) == []
    (row,) = rows(file).values()
    assert row["why"] == (
        "lost with each worker that was at work on it, 1 in all, most likely for want of memory or "
        f"of time (what they said is in {file.with_suffix('.batch')}/workers); run again to go on"
    )


def test_what_slurm_refuses_is_told_in_its_words(file: Path, variables: dict[str, str]) -> None:
    file.write_text(STUDY + 'queue = "nowhere"\n', encoding="utf-8")
    run = command(file, variables)
    _, complaints = run.communicate(timeout=300)
    assert run.returncode == 1 and left(file, partial(queued, variables)) == []
    assert complaints == (
        f"prismid: {file}: cluster: found “sbatch: error: invalid partition specified: nowhere; "
        "sbatch: error: Batch job submission failed: Invalid partition name specified”, expected "
        "keys that it takes\n"
    )


def test_jobs_that_bring_no_worker_are_told(file: Path, variables: dict[str, str]) -> None:
    """As where nodes do not reach the machine of the command: it waited for ever."""
    file.write_text(STUDY + 'job_script_prologue = ["exit 1"]\n', encoding="utf-8")
    variables = variables | agreed(file)
    run = command(file, variables, SOON_SILENT)
    _, complaints = run.communicate(timeout=300)
    assert run.returncode == 1 and left(file, partial(queued, variables)) == []
    said = r"cluster: found jobs \d+, \d+, \d+ that have begun and brought no worker \(what they"
    assert re.match(rf"prismid: {re.escape(str(file))}: {said} said is in .*workers", complaints)
    assert complaints.count("\n") == 1


def test_jobs_that_wait_are_told_with_the_reason_of_slurm(
    file: Path, variables: dict[str, str]
) -> None:
    file.write_text(STUDY + 'job_extra_directives = ["--hold"]\n', encoding="utf-8")
    run = command(file, variables | agreed(file), SOON_TOLD)
    try:
        assert run.stdout is not None
        told = next(line for line in run.stdout if "jobs of slurm wait" in line)
    finally:
        os.killpg(run.pid, signal.SIGINT)
        run.communicate(timeout=300)
    assert re.search(r"all jobs of slurm wait: [123] × “JobHeldUser”$", told.strip())
    assert left(file, partial(queued, variables)) == []
