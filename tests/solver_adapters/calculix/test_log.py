"""Real logs of CalculiX 2.20 (tests/data/solver/ORIGIN.md)."""

from __future__ import annotations

import gzip
from pathlib import Path

import pytest

from solver_adapters.calculix.log import cause, parse_status, version_in
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
    assert parse_status(text) is EXPECTED[name]


CAUSES = {
    "done": "",
    "diverged": "*ERROR: solution seems to diverge; please try\n automatic incrementation;",
    "no_material": "*ERROR reading *SOLID SECTION: nonexistent material",
    "missing_include": "*ERROR in readinput: cannot open file nomesh.inp",
    "oom": "*ERROR in u_calloc: error allocating memory\nvariable=mast1",
}


@pytest.mark.parametrize(("name", "words"), CAUSES.items())
def test_the_cause_is_the_first_error_of_a_log(name: str, words: str) -> None:
    found = cause(gzip.decompress((LOGS / f"{name}.log.gz").read_bytes()).decode())
    assert " ".join(found.split()).startswith(" ".join(words.split()))
    assert bool(found) == bool(words)


def test_the_version_is_read_from_what_ccx_prints() -> None:
    assert version_in("\nThis is Version 2.20\n\n") == "CalculiX 2.20"
    assert version_in("ccx: error while loading shared libraries: libspooles.so") is None


def test_every_stored_log_is_understood_here() -> None:
    assert {path.name.removesuffix(".log.gz") for path in LOGS.glob("*.log.gz")} == set(EXPECTED)


def test_a_log_that_breaks_off_says_nothing_of_a_failure() -> None:
    """A killed run: its exit code tells, and its files are truncated."""
    text = gzip.decompress((LOGS / "done.log.gz").read_bytes()).decode()
    assert parse_status(text[: len(text) // 2]) is Status.DONE
    assert parse_status("") is Status.DONE
