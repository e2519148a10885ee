"""Increments of a real run (tests/data/solver/ORIGIN.md)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from solver_adapters.calculix.sta import reached, read_increments
from solver_adapters.result_files import ResultFileError
from tests.solver_adapters.calculix.results import DATA, HELD


def test_the_increments_of_a_real_run_end_at_the_ends_of_its_steps() -> None:
    found = read_increments(DATA / "job.sta", HELD)
    assert (np.diff(found.ends) > 0).all()
    assert set(HELD) <= set(found.ends)
    rows = (DATA / "job.sta").read_text().splitlines()[2:]
    assert found.cuts == sum("U" in row for row in rows)
    assert len(found.ends) == len(rows) - found.cuts
    assert found.iterations == sum(int(row.split()[3]) for row in rows)


def test_increments_of_an_unfinished_run_are_refused() -> None:
    with pytest.raises(ResultFileError, match="found \\*STEP 3 as the last one, expected 4"):
        read_increments(DATA / "job.sta", np.array([2.0, 4.0, 6.0, 8.0]))


def test_a_run_that_goes_on_tells_the_end_of_its_last_increment(tmp_path: Path) -> None:
    growing = tmp_path / "job.sta"
    assert reached(growing) is None
    lines = (DATA / "job.sta").read_text().splitlines(keepends=True)
    growing.write_text("".join(lines[:3]))
    assert reached(growing) is None, "the first attempt has failed"
    growing.write_text("".join(lines[:5]))
    assert reached(growing) == 1.0
