"""The three result files of a real run (tests/data/solver/ORIGIN.md), whole and spoilt."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from solver_adapters.bundled.adapter import BundledAdapter
from solver_adapters.calculix.adapter import CalculixAdapter
from solver_adapters.calculix.dat import read_force
from solver_adapters.calculix.frd import read_displacements
from solver_adapters.calculix.sta import read_increments
from solver_adapters.interface import Simulation
from solver_adapters.result_files import ResultFileError
from tests.templates.golden_decks import CASES

DATA = Path(__file__).parents[2] / "data" / "solver" / "calculix"
ASKED = CASES["octahedral"]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for kind in ("frd", "dat", "sta"):
        shutil.copy(DATA / f"job.{kind}", tmp_path)
    return tmp_path


def test_a_real_run_is_read_whole(folder: Path) -> None:
    found = CalculixAdapter().read(ASKED, folder)
    low, high = ASKED.mesh.nodes["S_MINUS"], ASKED.mesh.nodes["S_PLUS"]
    assert not found.displacement[:, low].any()
    # The strains 0.01, 0.01, 0.006 of 4 µm; six digits are in the file.
    motion = np.array([0.0, 0.04, 0.04, 0.024])[:, None]
    np.testing.assert_allclose(found.displacement[:, high, 1], motion + 0 * high, rtol=1e-6)
    assert found.force[0] == 0.0
    assert found.force[1] > found.force[2] > 0 > found.force[3]
    assert found.steps == len(found.ends)
    assert found.ends[-1] == 6.0
    assert set(ASKED.times[1:]) <= set(found.ends)


def test_what_is_read_agrees_with_the_bundled_solver_at_the_steps_that_are_read(
    folder: Path,
) -> None:
    """Steps this large show CalculiX's own error, most where a hold is one step (row 2)."""
    found = CalculixAdapter().read(ASKED, folder)
    expected = BundledAdapter().solve(replace(ASKED, steps=found.ends))
    error = abs(found.force - expected.force) / abs(expected.force).max()
    assert error[[1, 3]].max() < 6e-3
    assert error[2] < 3e-2


def read(folder: Path) -> str:
    with pytest.raises(ResultFileError) as error:
        CalculixAdapter().read(ASKED, folder)
    message = str(error.value)
    assert "found" in message
    assert "expected" in message
    assert "\n" not in message
    return message


@pytest.mark.parametrize("kind", ["frd", "dat", "sta"])
@pytest.mark.parametrize(
    ("spoil", "word"),
    [
        (lambda path: path.unlink(), "no such file"),
        (lambda path: path.write_text(""), "empty"),
        (lambda path: path.write_bytes(b"\x89HDF\r\n\x1a\n\xff\x00 foreign"), ""),
        (lambda path: path.write_text(path.read_text()[: len(path.read_text()) * 6 // 10]), ""),
    ],
    ids=["missing", "empty", "foreign", "truncated"],
)
def test_a_spoilt_file_is_named_in_one_sentence(
    kind: str, spoil: Callable[[Path], object], word: str, folder: Path
) -> None:
    spoil(folder / f"job.{kind}")
    message = read(folder)
    assert message.startswith(f"job.{kind}: ")
    assert word in message


def test_a_file_cut_after_its_last_row_is_truncated(folder: Path) -> None:
    path = folder / "job.frd"
    path.write_text(path.read_text().removesuffix(" 9999\n"))
    assert "truncated" in read(folder)


def test_instants_that_were_not_reached_are_counted(folder: Path) -> None:
    lines = (folder / "job.frd").read_text().splitlines(keepends=True)
    last = max(i for i, line in enumerate(lines) if line.startswith("    1PSTEP"))
    (folder / "job.frd").write_text("".join(lines[:last]) + " 9999\n")
    assert "found 2 of 3 instants" in read(folder)


def test_results_of_another_mesh_are_told_by_their_nodes() -> None:
    steps, nodes = np.array([1, 3]), np.array([3, 700])
    with pytest.raises(ResultFileError, match="no displacement of 1 of 2 nodes.* node 701"):
        read_displacements(DATA / "job.frd", steps, nodes)


def test_a_number_that_overflowed_its_columns_is_no_displacement(folder: Path) -> None:
    path = folder / "job.frd"
    path.write_text(path.read_text().replace(" 4.00000E-02", "************", 1))
    assert "no displacement" in read(folder)


def test_reactions_of_another_set_or_at_other_instants_are_refused() -> None:
    with pytest.raises(ResultFileError, match="found the set S_PLUS, expected .* of LEFT"):
        read_force(DATA / "job.dat", "LEFT", np.array([2.0]))
    with pytest.raises(ResultFileError, match="no sum of reactions at 3 s"):
        read_force(DATA / "job.dat", "S_PLUS", np.array([2.0, 3.0]))


def test_increments_of_an_unfinished_run_are_refused() -> None:
    with pytest.raises(ResultFileError, match="found \\*STEP 3 as the last one, expected 4"):
        read_increments(DATA / "job.sta", np.array([2.0, 4.0, 6.0, 8.0]))


def _later(simulation: Simulation) -> Simulation:
    return replace(simulation, times=simulation.times + 100.0)


def test_instants_count_from_the_first_one_of_the_simulation(folder: Path) -> None:
    found = CalculixAdapter().read(_later(ASKED), folder)
    assert found.ends[-1] == 106.0
    np.testing.assert_array_equal(found.force, CalculixAdapter().read(ASKED, folder).force)


def test_a_result_that_is_a_folder_is_told_in_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "job.dat").mkdir()
    with pytest.raises(ResultFileError, match=r"^job.dat: found no file that can be read \(Is a d"):
        read_force(tmp_path / "job.dat", "S", np.array([1.0]))
