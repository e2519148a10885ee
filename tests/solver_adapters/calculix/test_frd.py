"""Displacements of a real run (tests/data/solver/ORIGIN.md), whole and spoilt."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from solver_adapters.calculix.frd import read_displacements
from solver_adapters.result_files import ResultFileError
from tests.solver_adapters.calculix.results import ASKED, DATA

STEPS = np.array([1, 2, 3])


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return Path(shutil.copy(DATA / "job.frd", tmp_path))


def refusal(path: Path) -> str:
    with pytest.raises(ResultFileError) as error:
        read_displacements(path, STEPS, ASKED.output_nodes)
    return str(error.value)


def test_displacements_come_in_the_order_of_the_wanted_steps_and_nodes(path: Path) -> None:
    high = ASKED.mesh.nodes["S_PLUS"]
    found = read_displacements(path, STEPS[::-1], high[::-1])
    # The strains 0.006, 0.01, 0.01 of 4 µm; six digits are in the file.
    motion = np.array([0.024, 0.04, 0.04])[:, None]
    np.testing.assert_allclose(found[:, :, 1], motion + 0 * high, rtol=1e-6)


def test_a_file_cut_after_its_last_row_is_truncated(path: Path) -> None:
    path.write_text(path.read_text().removesuffix(" 9999\n"))
    assert "truncated" in refusal(path)


def test_instants_that_were_not_reached_are_counted(path: Path) -> None:
    lines = path.read_text().splitlines(keepends=True)
    last = max(i for i, line in enumerate(lines) if line.startswith("    1PSTEP"))
    path.write_text("".join(lines[:last]) + " 9999\n")
    assert "found 2 of 3 instants" in refusal(path)


def test_results_of_another_mesh_are_told_by_their_nodes() -> None:
    steps, nodes = np.array([1, 3]), np.array([3, 700])
    with pytest.raises(ResultFileError, match="no displacement of 1 of 2 nodes.* node 701"):
        read_displacements(DATA / "job.frd", steps, nodes)


def test_a_number_that_overflowed_its_columns_is_no_displacement(path: Path) -> None:
    path.write_text(path.read_text().replace(" 4.00000E-02", "************", 1))
    assert "no displacement" in refusal(path)
