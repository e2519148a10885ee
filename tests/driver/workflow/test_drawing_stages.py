"""What the stages of a run import before they begin."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from driver.workflow import drawing_stages
from solver_adapters.kernels import PACKAGES


def test_a_run_begins_without_what_draws_and_what_knows_distributions() -> None:
    code = (
        "import driver.workflow.pipeline, sys\n"
        "print(*{'matplotlib', 'scipy.stats'} & {*sys.modules})"
    )
    found = subprocess.run(
        [sys.executable, "-c", code], env=os.environ | {"PYTHONPATH": str(PACKAGES)},
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert found.stdout == "\n"


@pytest.mark.parametrize(
    ("stage", "name"),
    [
        ("measure_stage", "run_measure"),
        ("advise_stage", "run_advise"),
        ("report_stage", "run_report"),
        ("report_stage", "run_report_identified"),
        ("report_loads_stage", "run_report_loads"),
    ],
)
def test_each_stage_is_that_of_its_module(
    stage: str, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    called: list[object] = []
    monkeypatch.setattr(f"driver.workflow.{stage}.{name}", lambda *given: called.extend(given))
    context = object()
    getattr(drawing_stages, name)(context)
    assert called[0] is context
