"""Each subject has one script, which runs as a file and as a module, from any folder."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parents[1]
SUBJECTS = (
    "solver", "adapters", "numerics", "dic", "identification", "diagnosis", "scale", "people",
    "reliability",
)  # fmt: skip


@pytest.mark.parametrize("subject", SUBJECTS)
def test_the_script_of_a_subject_starts_from_any_folder(subject: str, tmp_path: Path) -> None:
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    command = [sys.executable, str(BENCHMARKS / f"{subject}.py"), "--help"]
    answer = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert answer.returncode == 0, answer.stderr
    assert "--quick" in answer.stdout
