"""A trial of the blind trial, from its draw to its answer, on a converged truth.

How often an effect of each kind is found, inside the library and outside it, and how often nothing
is said where nothing is hidden, is what the trial measures (benchmarks/diagnosis.md).
"""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.blind_trial import Task, carried_out, planned

pytestmark = pytest.mark.slow

SEED = 7  # that of the trial


def test_without_an_effect_nothing_is_said(tmp_path: Path) -> None:
    trial = next(trial for trial in planned(SEED, tmp_path) if trial.kind == "null")
    line = carried_out(Task(trial, tmp_path, tmp_path / "results.jsonl", "test"))
    assert "verdict" in line, f"{line['trial']}: {line['answer']}, {line['why']}"
    assert line["verdict"] == "nothing wrong", f"{line['misfit']:.1f} sigma: {line['answer']}"
