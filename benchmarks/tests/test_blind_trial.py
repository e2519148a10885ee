"""Effects of kinds, signs and sizes that a seed draws are hidden; images to verdict find them.

The truths are simulated on a finer mesh and in finer steps than any that the diagnosis has; no
stage is told the seed, the truth or its size.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import chain, islice
from pathlib import Path

import pytest

from benchmarks.blind_figures import has_both, has_class
from benchmarks.blind_plan import ENOUGH, NOISES, PAIR_LEVEL, Kind, Trial
from benchmarks.blind_store import Record
from benchmarks.blind_trial import BY_NAME, Task, carried_out, planned
from driver.common.parallel import side_by_side

pytestmark = pytest.mark.slow

SEED = 20
KINDS_OF_EFFECTS = 10
CATEGORIES = {"material", "microstructure", "boundary", "instrument"}
WITHOUT = 8  # experiments of which the effect is taken out again
SEEN = 5.0  # σ of what the fit of the experiment itself leaves that looks like the effect
LARGE = 12.0  # σ that the fit leaves of an effect outside the library
PROCESSES = os.cpu_count() or 1
MOST = 20  # effects that may be hidden until so many kinds were large enough


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("truths")


@pytest.fixture(scope="module")
def trials(cache: Path) -> tuple[Trial, ...]:
    return planned(SEED, cache)


def answered(trials: Sequence[Trial], cache: Path) -> list[Record]:
    """What is answered to some trials, side by side."""
    tasks = [Task(trial, cache, cache / "results.jsonl", "test") for trial in trials]
    lines = side_by_side(carried_out, tasks, PROCESSES, 1)
    for line in lines:
        assert "verdict" in line, f"{line['trial']}: {line['answer']}, {line['why']}"
    return lines


def in_turn(trials: Iterator[Trial], cache: Path) -> Iterator[Record]:
    """The same, no more at a time than run side by side, as far as they are asked for."""
    while few := list(islice(trials, PROCESSES)):
        yield from answered(few, cache)


def one_of_each(trials: tuple[Trial, ...]) -> Iterator[Trial]:
    """One trial of each cause that can be hidden well enough, in the order of the draw."""
    met = set()
    for trial in trials:
        if trial.kind == "cause" and trial.level >= ENOUGH and trial.truths[0] not in met:
            met.add(trial.truths[0])
            yield trial


@pytest.fixture(scope="module")
def hidden(trials: tuple[Trial, ...], cache: Path) -> list[Record]:
    """What was answered to ten kinds of effects of 5 σ and more, by the real crystal solver."""
    lines = in_turn(islice(one_of_each(trials), MOST), cache)
    seen = (line for line in lines if min(line["like_itself"]) >= SEEN)
    found = list(islice(seen, KINDS_OF_EFFECTS))
    assert len(found) == KINDS_OF_EFFECTS, "the draw holds too few effects that can be seen"
    categories = {BY_NAME[line["trial"]["truths"][0]].category for line in found}
    assert categories == CATEGORIES, "the draw holds no effect of a category"
    return found


def told(line: Record) -> str:
    return f"{line['hidden']} ({line['misfit']:.1f} sigma): {line['answer']}"


def first(trials: tuple[Trial, ...], kind: Kind) -> Trial:
    return next(trial for trial in trials if trial.kind == kind)


def test_effects_of_ten_kinds_are_named_or_what_cannot_be_told_from_them(
    hidden: list[Record],
) -> None:
    missed = [told(line) for line in hidden if not has_class(line)]
    assert not missed, missed


def test_without_the_effect_the_finding_is_gone(hidden: list[Record], cache: Path) -> None:
    """The same relief, stage errors and noise; only the effect is taken out."""
    bare = [
        Trial(
            name=drawn["name"], kind="null", truths=(), directions=(), level=0.0, companions=(),
            seed=drawn["seed"],
        )
        for drawn in (line["trial"] for line in hidden[:WITHOUT])
    ]  # fmt: skip
    for line, without in zip(hidden[:WITHOUT], answered(bare, cache), strict=True):
        named = set(chain.from_iterable(line["sets"]))
        assert not named & set(without["said"]), told(without)
        assert without["verdict"] == "nothing wrong", told(without)


def test_of_the_two_clearest_effects_at_once_both_are_found(
    hidden: list[Record], cache: Path
) -> None:
    one, two = sorted(hidden, key=lambda line: -min(line["like_itself"]))[:2]
    drawn = [line["trial"] for line in (one, two)]
    pair = Trial(
        name="pair", kind="pair", truths=tuple(trial["truths"][0] for trial in drawn),
        directions=tuple(tuple(trial["directions"][0]) for trial in drawn), level=PAIR_LEVEL,
        companions=(), seed=drawn[0]["seed"],
    )  # fmt: skip
    (line,) = answered([pair], cache)
    assert has_both(line), told(line)


def test_an_effect_outside_the_library_is_seen_and_not_explained_away(
    trials: tuple[Trial, ...], cache: Path
) -> None:
    """The first one of which the fit leaves much: of a smaller one the library may take it all."""
    outside = islice((trial for trial in trials if trial.kind == "outside"), MOST // 2)
    lines = in_turn(outside, cache)
    line = next((line for line in lines if line["misfit"] >= LARGE), None)
    assert line is not None, "the draw holds no large effect outside the library"
    assert line["verdict"] in ("unexplained", "named, but something is left"), told(line)


def test_noises_that_the_case_does_not_state_are_named(
    trials: tuple[Trial, ...], cache: Path
) -> None:
    """Of the boundary 0.5 nm: 1 nm bends the loads, and is found in half of the trials."""
    sizes = {"boundary_noise": min, "noise_not_uniform": max}
    wanted = [((noise,), size(NOISES[noise])) for noise, size in sizes.items()]
    drawn = [next(t for t in trials if (t.truths, t.level) == one) for one in wanted]
    for line in answered(drawn, cache):
        assert line["trial"]["truths"][0] in line["said"], told(line)


def test_a_half_turn_of_the_ebsd_frame_is_named_and_loads_noisier_than_stated_name_nothing(
    trials: tuple[Trial, ...], cache: Path
) -> None:
    louder = replace(first(trials, "noise level"), level=1.3)
    turned, silent = answered([first(trials, "flip"), louder], cache)
    assert turned["trial"]["truths"][0] in turned["said"], told(turned)
    assert silent["verdict"] == "nothing wrong", told(silent)
