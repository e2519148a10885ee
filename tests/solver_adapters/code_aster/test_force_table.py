"""The table of resultants of Code_Aster 15.2 on the prism (tests/data/solver/ORIGIN.md)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from solver_adapters.code_aster.force_table import read_resultants
from solver_adapters.result_files import ResultFileError
from tools.code_aster_cases import unpacked
from tools.code_aster_prism import forces


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return unpacked("prism_forces.csv", tmp_path, "forces.csv")


def test_the_resultant_of_a_group_is_read_at_the_wanted_instants(path: Path) -> None:
    _, rows = forces()
    wanted = rows[[30, 0, 7]]
    found = read_resultants(path, "S_PLUS", "DY", wanted[:, 0])
    np.testing.assert_allclose(found, wanted[:, 1], rtol=1e-12)


def test_the_ends_are_in_equilibrium(path: Path) -> None:
    instants = forces()[1][:, 0]
    plus, minus = (read_resultants(path, name, "DY", instants) for name in ("S_PLUS", "S_MINUS"))
    assert abs(plus + minus).max() < 1e-3  # µN


def test_what_is_not_in_the_table_is_named(path: Path) -> None:
    with pytest.raises(ResultFileError, match="41 instants of S_PLUS; expected 0.1 s and 1 others"):
        read_resultants(path, "S_PLUS", "DY", np.array([0.0, 0.1, 99.0]))
    with pytest.raises(ResultFileError, match="0 instants of LEFT; expected 0 s"):
        read_resultants(path, "LEFT", "DY", np.array([0.0]))


@pytest.mark.parametrize("content", ["", "node,x\n1,2\n", "INTITULE,INST,DY\nS_PLUS,1,none\n"])
def test_a_spoilt_table_is_one_clear_error(path: Path, content: str) -> None:
    path.write_text(content)
    with pytest.raises(ResultFileError, match="forces.csv: found no such table .*expected the res"):
        read_resultants(path, "S_PLUS", "DY", np.array([1.0]))
    path.unlink()
    with pytest.raises(ResultFileError, match="forces.csv: no such file"):
        read_resultants(path, "S_PLUS", "DY", np.array([1.0]))
