"""Why jobs wait, by answers in the form of Slurm and PBS; test_slurm.py asks a real one."""

from __future__ import annotations

from pathlib import Path

import pytest

from driver.batch.waiting_jobs import why_jobs_wait
from tests.driver.batch.queue_commands import asked_of

OF_SLURM = "squeue", "--noheader --format=%T|%r --jobs=7,8,9"
OF_PBS = "qstat", "-f 7 8 9"
WAITS = """\
Job Id: 7.host
    Resource_List.ncpus = 1
    comment = Not Running: Insufficient amo
\tunt of resource: mem (R: 900gb A: 24gb)
    job_state = Q
"""


@pytest.mark.parametrize(
    ("command", "says", "told"),
    [
        (
            OF_SLURM,
            "PENDING|Resources\nPENDING|Priority\nPENDING|Priority \n",
            "2 × “Priority”; 1 × “Resources”",
        ),
        (OF_SLURM, "".join(f"PENDING|{why}\n" for why in "dcba"), "1 × “a”; 1 × “b”; 1 × “c”; …"),
        (OF_SLURM, "PENDING|Priority\nPENDING|None\nPENDING|Priority\n", ""),
        (OF_SLURM, "PENDING|Priority\nRUNNING|None\nPENDING|Priority\n", ""),
        (OF_SLURM, "slurm_load_jobs error: Invalid job id\n", ""),
        (
            OF_PBS,
            3 * WAITS,
            "3 × “Not Running: Insufficient amount of resource: mem (R: 900gb A: 24gb)”",
        ),
        (OF_PBS, 2 * WAITS + WAITS.replace("= Q", "= R"), ""),
        (OF_PBS, 3 * WAITS.replace("comment", "Comment"), ""),
        (("bjobs", "7 8 9"), "", ""),
    ],
)
def test_why_jobs_wait_is_told_in_the_words_of_the_queue_system_where_all_wait(
    command: tuple[str, str], says: str, told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked_of(tmp_path, monkeypatch, *command).write_text(says, encoding="utf-8")
    system = {"squeue": "slurm", "qstat": "pbs"}.get(command[0], "lsf")
    assert why_jobs_wait(system, ["7", "8", "9"]) == told


def test_an_answer_in_another_encoding_ends_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    answer = asked_of(tmp_path, monkeypatch, "squeue", "--noheader --format=%T|%r --jobs=7")
    answer.write_bytes("PENDING|Priorität\n".encode("latin-1"))
    assert why_jobs_wait("slurm", ["7"]) == "1 × “Priorit�t”"


def test_a_queue_system_that_does_not_answer_says_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    assert why_jobs_wait("slurm", ["7"]) == ""
