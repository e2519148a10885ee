"""Displacements and reactions of a real run (tests/data/solver/ORIGIN.md)."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from solver_adapters.calculix.dat import read_displacements, read_force
from solver_adapters.result_files import ResultFileError
from tests.solver_adapters.calculix.results import ASKED, DATA, HELD


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


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return Path(shutil.copy(DATA / "job.dat", tmp_path))


def refusal(path: Path) -> str:
    with pytest.raises(ResultFileError) as error:
        read_displacements(path, "OUTPUT", HELD, ASKED.output_nodes)
    return str(error.value)


def test_displacements_come_in_the_order_of_the_wanted_nodes(path: Path) -> None:
    high = ASKED.mesh.nodes["S_PLUS"]
    found = read_displacements(path, "OUTPUT", HELD, high[::-1])
    # The strains 0.01, 0.01, 0.006 of 4 µm; seven digits are in the file.
    motion = np.array([0.04, 0.04, 0.024])[:, None]
    np.testing.assert_allclose(found[:, :, 1], motion + 0 * high, rtol=1e-6)
    whole = read_displacements(path, "OUTPUT", HELD, np.arange(len(ASKED.mesh.points)))
    np.testing.assert_array_equal(whole[:, high[::-1]], found)


def test_instants_that_were_not_reached_are_counted(path: Path) -> None:
    text = path.read_text()
    path.write_text(text[: text.rindex(" displacements")])
    message = "found no displacements at 6 s (it has 2 instants up to 4 s), expected 3"
    assert message in refusal(path)


def test_a_block_that_was_cut_lacks_nodes(path: Path) -> None:
    lines = path.read_text().splitlines(keepends=True)
    last = max(i for i, line in enumerate(lines) if "displacements" in line)
    path.write_text("".join(lines[: last + 5]))
    assert "no displacement of" in refusal(path)


def test_results_of_another_mesh_are_told_by_their_nodes(path: Path) -> None:
    with pytest.raises(ResultFileError, match="no displacement of 1 of 2 nodes.* node 701"):
        read_displacements(path, "OUTPUT", HELD, np.array([3, 700]))


def test_displacements_of_another_set_are_refused(path: Path) -> None:
    with pytest.raises(ResultFileError, match="found the set OUTPUT, expected .* of FACE"):
        read_displacements(path, "FACE", HELD, ASKED.output_nodes)


def test_a_number_that_overflowed_its_columns_is_no_displacement(path: Path) -> None:
    path.write_text(path.read_text().replace(" 4.000000E-02", "*************", 1))
    assert "expected the displacements of OUTPUT" in refusal(path)
