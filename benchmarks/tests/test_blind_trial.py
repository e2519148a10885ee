"""Effects that a seed draws are hidden in converged truths; images to verdict find them.

No stage is told the seed, the truth or its size. How often an effect of each kind is found, and how
often nothing is said where nothing is hidden, is what the trial measures (benchmarks/diagnosis.md).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from itertools import islice
from pathlib import Path

import pytest

from benchmarks.blind_figures import has_class
from benchmarks.blind_plan import ENOUGH, Trial
from benchmarks.blind_store import Record
from benchmarks.blind_trial import BY_NAME, Task, carried_out, planned

pytestmark = pytest.mark.slow

SEED = 7  # that of the trial
SEEN = 5.0  # σ of what the fit of the experiment itself leaves that looks like the effect
LARGE = 12.0  # σ that the fit leaves of an effect outside the library
MOST = 4  # effects of a kind that may be hidden until one was large enough


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("truths")


@pytest.fixture(scope="module")
def trials(cache: Path) -> tuple[Trial, ...]:
    return planned(SEED, cache)


def answered(trial: Trial, cache: Path) -> Record:
    """What is answered to a trial."""
    line = carried_out(Task(trial, cache, cache / "results.jsonl", "test"))
    assert "verdict" in line, f"{line['trial']}: {line['answer']}, {line['why']}"
    return line


def first_large(trials: Iterable[Trial], cache: Path, size: Callable[[Record], float]) -> Record:
    """What is answered to the first of some trials of whose effect the fit leaves enough."""
    for trial in islice(trials, MOST):
        line = answered(trial, cache)
        if size(line) >= (LARGE if trial.kind == "outside" else SEEN):
            return line
    raise AssertionError("the draw holds no effect of this kind that can be seen")


def told(line: Record) -> str:
    return f"{line['hidden']} ({line['misfit']:.1f} sigma): {line['answer']}"


def test_the_first_effect_of_the_law_is_named_or_what_cannot_be_told_from_it(
    trials: tuple[Trial, ...], cache: Path
) -> None:
    of_law = (
        trial
        for trial in trials
        if trial.kind == "cause"
        and trial.level >= ENOUGH
        and BY_NAME[trial.truths[0]].category == "material"
    )
    line = first_large(of_law, cache, lambda x: min(x["like_itself"]))
    assert has_class(line), told(line)


def test_without_an_effect_nothing_is_said(trials: tuple[Trial, ...], cache: Path) -> None:
    line = answered(next(t for t in trials if t.kind == "null"), cache)
    assert line["verdict"] == "nothing wrong", told(line)


def test_an_effect_outside_the_library_is_seen_and_not_explained_away(
    trials: tuple[Trial, ...], cache: Path
) -> None:
    """The first one of which the fit leaves much: of a smaller one the library may take it all."""
    outside = (trial for trial in trials if trial.kind == "outside")
    line = first_large(outside, cache, lambda x: float(x["misfit"]))
    assert line["verdict"] in ("unexplained", "named, but something is left"), told(line)
