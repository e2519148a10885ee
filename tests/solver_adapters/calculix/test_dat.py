"""Reactions of a real run (tests/data/solver/ORIGIN.md)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from solver_adapters.calculix.dat import read_force
from solver_adapters.result_files import ResultFileError
from tests.solver_adapters.calculix.results import DATA, HELD


def test_the_reactions_of_a_real_run_are_read_at_each_instant() -> None:
    """The clamped box pulled to 1 %, held, and unloaded: along Y it pulls, relaxes and pushes."""
    force = read_force(DATA / "job.dat", "S_PLUS", HELD)
    assert force.shape == (3, 3)
    assert force[0, 1] > force[1, 1] > 0 > force[2, 1]
    np.testing.assert_array_equal(read_force(DATA / "job.dat", "S_PLUS", HELD[:1]), force[:1])


def test_reactions_of_another_set_or_at_other_instants_are_refused() -> None:
    with pytest.raises(ResultFileError, match="found the set S_PLUS, expected .* of LEFT"):
        read_force(DATA / "job.dat", "LEFT", np.array([2.0]))
    with pytest.raises(ResultFileError, match="no sum of reactions at 3 s"):
        read_force(DATA / "job.dat", "S_PLUS", np.array([2.0, 3.0]))


def test_a_result_that_is_a_folder_is_told_in_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "job.dat").mkdir()
    with pytest.raises(ResultFileError, match=r"^job.dat: found no file that can be read \(Is a d"):
        read_force(tmp_path / "job.dat", "S", np.array([1.0]))
