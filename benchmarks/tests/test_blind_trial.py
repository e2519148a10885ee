"""An effect that a seed draws is hidden in a converged truth; images to verdict find it.

No stage is told the seed, the truth or its size. How often an effect of each kind is found, and how
often nothing is said where nothing is hidden, is what the trial measures (benchmarks/diagnosis.md).
Effects that the library describes, and none, are hidden in tests/driver/diagnosis.
"""

from __future__ import annotations

from itertools import islice
from pathlib import Path

import pytest

from benchmarks.blind_plan import Trial
from benchmarks.blind_store import Record
from benchmarks.blind_trial import Task, carried_out, planned

pytestmark = pytest.mark.slow

SEED = 7  # that of the trial
LARGE = 12.0  # σ that the fit leaves of an effect outside the library
MOST = 4  # effects that may be hidden until one was large enough


def answered(trial: Trial, cache: Path) -> Record:
    """What is answered to a trial."""
    line = carried_out(Task(trial, cache, cache / "results.jsonl", "test"))
    assert "verdict" in line, f"{line['trial']}: {line['answer']}, {line['why']}"
    return line


def test_an_effect_outside_the_library_is_seen_and_not_explained_away(tmp_path: Path) -> None:
    """The first one of which the fit leaves much: of a smaller one the library may take it all."""
    outside = (trial for trial in planned(SEED, tmp_path) if trial.kind == "outside")
    lines = (answered(trial, tmp_path) for trial in islice(outside, MOST))
    line = next((line for line in lines if line["misfit"] >= LARGE), None)
    assert line is not None, "the draw holds no effect outside the library that can be seen"
    told = f"{line['hidden']} ({line['misfit']:.1f} sigma): {line['answer']}"
    assert line["verdict"] in ("unexplained", "named, but something is left"), told
