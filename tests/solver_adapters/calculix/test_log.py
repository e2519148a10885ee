"""Real logs of CalculiX 2.20 (tests/data/solver/ORIGIN.md)."""

from __future__ import annotations

import gzip
from pathlib import Path

import pytest

from solver_adapters.calculix.log import understand
from solver_adapters.external import Status

LOGS = Path(__file__).parents[2] / "data" / "solver" / "calculix"
EXPECTED = {
    "done": Status.DONE,
    "diverged": Status.NOT_CONVERGED,
    "too_many_cutbacks": Status.NOT_CONVERGED,
    "point_without_solution": Status.NOT_CONVERGED,
    "no_material": Status.BAD_DECK,
    "missing_include": Status.BAD_DECK,
    "oom": Status.OUT_OF_MEMORY,
}


@pytest.mark.parametrize("name", EXPECTED)
def test_a_log_says_how_the_run_ended(name: str) -> None:
    text = gzip.decompress((LOGS / f"{name}.log.gz").read_bytes()).decode()
    assert understand(text) is EXPECTED[name]


def test_every_stored_log_is_understood_here() -> None:
    assert {path.name.removesuffix(".log.gz") for path in LOGS.glob("*.log.gz")} == set(EXPECTED)


def test_a_log_that_breaks_off_says_nothing_of_a_failure() -> None:
    """A killed run: its exit code tells, and its files are truncated."""
    text = gzip.decompress((LOGS / "done.log.gz").read_bytes()).decode()
    assert understand(text[: len(text) // 2]) is Status.DONE
    assert understand("") is Status.DONE
