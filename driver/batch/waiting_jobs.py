"""Why jobs of a queue system wait, in its words."""

from __future__ import annotations

import re
import subprocess
from collections import Counter
from collections.abc import Sequence

_ABOUT_JOBS = {
    "slurm": ("squeue --noheader --format=%T|%r --jobs={}", ","),
    "pbs": ("qstat -f {}", " "),
}
"""What is asked about jobs, with their numbers, and what stands between these."""
_IN_PBS = re.compile(r"^ *(job_state|comment) = (.+)$", re.MULTILINE)
_MOST = 3  # reasons that are told
_ANSWERED = 10.0  # s for an answer


def why_jobs_wait(system: str, ids: Sequence[str]) -> str:
    """Return what a queue system says of jobs that wait, "" where it does not say so of all.

    Args:
        system: its name.
        ids: of the jobs.
    """
    if system not in _ABOUT_JOBS:
        return ""
    asked, between = _ABOUT_JOBS[system]
    try:
        answer = subprocess.run(
            asked.format(between.join(ids)).split(),
            capture_output=True, text=True, errors="replace", timeout=_ANSWERED, check=False,
        )  # fmt: skip
    except (OSError, subprocess.TimeoutExpired):
        return ""
    reasons = (_reasons_of_slurm if system == "slurm" else _reasons_of_pbs)(answer.stdout)
    if answer.returncode or len(reasons) < len(ids):
        return ""
    found = sorted(Counter(reasons).items(), key=lambda one: (-one[1], one[0]))
    told = [f"{number} × “{why}”" for why, number in found[:_MOST]]
    return "; ".join(told + ["…"] * (len(found) > len(told)))


def without_numbers(words: str) -> str:
    """Return words without numbers, such as of what is free just now."""
    return re.sub(r"\d+", "", words)


def _reasons_of_slurm(said: str) -> list[str]:
    """Return why each job waits, but those that Slurm has not looked at yet."""
    states = [line.partition("|") for line in said.splitlines()]
    waiting = [why.strip() for state, _, why in states if state == "PENDING"]
    return [why for why in waiting if why not in ("", "None", "(null)")]


def _reasons_of_pbs(said: str) -> list[str]:
    """Return why each job waits, of those that PBS has looked at; long lines go on behind a tab."""
    jobs = [dict(_IN_PBS.findall(job)) for job in said.replace("\n\t", "").split("Job Id: ")]
    return [
        job["comment"] for job in jobs if job.get("job_state") in ("Q", "H") and "comment" in job
    ]
