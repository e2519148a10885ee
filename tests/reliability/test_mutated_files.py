"""Damaged files of unknown origin end in a sentence that names them, whatever the damage."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tools.mutated_files import KINDS, Kind, fault_of, mutated, seconds_of

LONGEST = 10.0  # s of the processor, for one file
KIND = pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
SEEDS = st.integers(0, 2**32 - 1)
# Damage that has ended in another error: numbers of nodes beyond all bounds, or none of them.
ONCE_MISSED = (
    ("plane mesh .msh", 28), ("plane mesh .msh", 331), ("plane mesh .msh", 473),
    ("plane mesh .msh", 1511), ("CalculiX .dat", 572), ("MED mesh", 606), ("MED mesh", 2461),
    ("Code_Aster results", 846),
)  # fmt: skip


def few(examples: int) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """The same inputs each time, none kept between runs."""
    return settings(
        max_examples=examples, derandomize=True, deadline=None, database=None,
        suppress_health_check=list(HealthCheck),
    )  # fmt: skip


def ends_in_a_sentence(kind: Kind, seed: int) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / kind.file
        path.write_bytes(mutated(kind.content(), seed))
        before = seconds_of(os.getpid())
        assert fault_of(kind, path) == "", f"seed {seed}"
        assert seconds_of(os.getpid()) - before < LONGEST, f"seed {seed}"


@KIND
def test_a_whole_file_is_read(kind: Kind, tmp_path: Path) -> None:
    kind.write(tmp_path / kind.file)
    kind.read(tmp_path / kind.file)


@KIND
def test_a_file_with_a_little_damage_is_read_or_refused_in_a_sentence(kind: Kind) -> None:
    @few(2)
    @given(SEEDS)
    def holds(seed: int) -> None:
        ends_in_a_sentence(kind, seed)

    holds()


@pytest.mark.parametrize(("name", "seed"), ONCE_MISSED)
def test_damage_that_was_missed_once_is_told(name: str, seed: int) -> None:
    ends_in_a_sentence(next(kind for kind in KINDS if kind.name == name), seed)


@pytest.mark.slow
def test_a_stored_response_at_which_hdf5_never_comes_back_is_told() -> None:
    ends_in_a_sentence(next(kind for kind in KINDS if kind.name == "stored response"), 248)


@pytest.mark.slow
@KIND
def test_a_damaged_file_is_read_or_refused_in_a_sentence(kind: Kind) -> None:
    @few(2000 // len(KINDS) + 1)
    @given(SEEDS)
    def holds(seed: int) -> None:
        ends_in_a_sentence(kind, seed)

    holds()


def test_the_damage_of_a_seed_is_always_the_same() -> None:
    content = KINDS[0].content()
    assert mutated(content, 5) == mutated(content, 5) != content
