"""Fields of real .rmed files of Code_Aster 15.2 (tests/data/solver/ORIGIN.md)."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest

from solver_adapters.code_aster.rmed import ResultFile
from solver_adapters.crystal import BCC, bunge_matrix, schmid_tensors
from solver_adapters.result_files import ResultFileError
from tools.code_aster_cases import DATA, unpacked

INSTANTS = np.array([0.0, 10.0, 50.0])
POINT = DATA.parent / "code_aster_point.npz"


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return unpacked("one_element.rmed", tmp_path, "nodes.rmed")


def test_stress_at_the_gauss_points_is_that_of_the_table_of_the_same_run(path: Path) -> None:
    with np.load(POINT) as data:
        table = data["table"]
    stress = ResultFile(path).at_gauss_points("SIEF_ELGA", INSTANTS)
    assert stress.values.shape == (3, 1, 8, 6)
    rows = table[[abs(table[:, 0] - instant).argmin() for instant in INSTANTS]]
    # The table: t, strain, SIXX, SIYY, SIZZ, SIXY, SIXZ, SIYZ; the stress is homogeneous.
    found = stress.pick("SIXX", "SIYY", "SIZZ", "SIXY", "SIXZ", "SIYZ")[:, 0]
    np.testing.assert_allclose(found, np.repeat(rows[:, None, 2:8], 8, axis=1), atol=1e-6)


def test_displacement_and_reaction_are_read_by_name_and_instant(path: Path) -> None:
    file = ResultFile(path)
    motion = file.nodal("DEPL", INSTANTS).pick("DY", "DX")
    # The upper nodes of the unit cube move by the strain: 0, 1 % and 1 % again.
    np.testing.assert_allclose(motion[:, [2, 3, 6, 7], 0], [[0.0] * 4, [0.01] * 4, [0.01] * 4])
    assert motion[1, 1, 1] < 0
    reaction = file.nodal("REAC_NODA", INSTANTS).pick("DY")[..., 0]
    np.testing.assert_allclose(reaction.sum(axis=1), 0.0, atol=1e-6)
    with np.load(POINT) as data:
        table = data["table"]
    expected = table[[abs(table[:, 0] - instant).argmin() for instant in INSTANTS], 3]
    # The section is 1 µm².
    np.testing.assert_allclose(reaction[:, [2, 3, 6, 7]].sum(axis=1), expected, atol=1e-6)


def test_slips_are_the_second_of_three_variables_of_a_system(path: Path) -> None:
    """V1–6, the plastic strain, is what the slips make of it."""
    state = ResultFile(path).at_gauss_points("VARI_ELGA", INSTANTS)
    slip = state.pick(*(f"V{6 + 3 * system + 2}" for system in range(24)))
    R = bunge_matrix(281, 8, 47)
    strain = np.einsum("tcgs,sij->tcgij", slip, R @ schmid_tensors(BCC) @ R.T)
    strain = 0.5 * (strain + np.swapaxes(strain, -1, -2))
    rows, columns = [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]
    expected = strain[..., rows, columns] * ([1.0] * 3 + [np.sqrt(2)] * 3)
    found = state.pick(*(f"V{i}" for i in range(1, 7)))
    assert abs(found).max() > 5e-3
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_an_instant_that_is_not_in_the_file_is_named(path: Path) -> None:
    with pytest.raises(ResultFileError) as error:
        ResultFile(path).nodal("DEPL", np.array([10.0, 12.5, 13.0]))
    assert str(error.value) == (
        f"{path}: the field DEPL has 3 instants from 0 to 50 s; expected 12.5 s and 1 others too"
    )


def test_a_field_that_is_not_in_the_file_is_named(path: Path) -> None:
    with pytest.raises(
        ResultFileError, match="found the fields U_______DEPL.*, expected FORC_NODA"
    ):
        ResultFile(path).nodal("FORC_NODA", INSTANTS)


def test_a_field_at_other_places_is_told(path: Path) -> None:
    with pytest.raises(ResultFileError, match="SIEF_ELGA has values at points, expected them at n"):
        ResultFile(path).nodal("SIEF_ELGA", INSTANTS)
    with pytest.raises(ResultFileError, match="DEPL has values at nodes, expected them at points"):
        ResultFile(path).at_gauss_points("DEPL", INSTANTS)


def test_a_file_that_is_missing_empty_truncated_or_foreign_is_one_clear_error(path: Path) -> None:
    whole = path.read_bytes()
    folder = path.parent
    with pytest.raises(ResultFileError, match="none.rmed: no such file"):
        ResultFile(folder / "none.rmed")
    contents = {
        "empty": (b"", "not a MED file, or a damaged one"),
        "truncated": (whole[: len(whole) // 2], "not a MED file, or a damaged one"),
        "foreign": (b"node,x,y\n1,0,0\n", "not a MED file, or a damaged one"),
    }
    for name, (content, words) in contents.items():
        other = folder / f"{name}.rmed"
        other.write_bytes(content)
        with pytest.raises(ResultFileError, match=f"{name}.rmed: {words}"):
            ResultFile(other)


def test_an_hdf5_file_of_something_else_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "results.h5"
    with h5py.File(path, "w") as file:
        file["force"] = [1.0]
    with pytest.raises(
        ResultFileError, match="not a MED file, or a damaged one; expected the fields"
    ):
        ResultFile(path)
