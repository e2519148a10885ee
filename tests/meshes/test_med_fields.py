"""Fields in MED files, against a result that Code_Aster wrote and by round trips."""

import gzip
from pathlib import Path

import h5py
import medcoupling as mc
import numpy as np
import pytest

from meshes.files import read_med, write_med
from meshes.med_fields import MedField, add_med_fields, read_med_fields
from meshes.prism_mesh import PrismMesh

DATA = Path(__file__).parents[1] / "data"
TIMES = np.array([0.0, 0.5, 40.25])


@pytest.fixture
def element(tmp_path: Path) -> Path:
    path = tmp_path / "element.rmed"
    path.write_bytes(gzip.decompress((DATA / "meshes" / "code_aster_element.rmed.gz").read_bytes()))
    return path


@pytest.fixture
def med(mesh: PrismMesh, tmp_path: Path) -> Path:
    path = tmp_path / "prism.med"
    write_med(mesh, path)
    return path


def nodal(mesh: PrismMesh) -> MedField:
    values = np.random.default_rng(1).random((3, len(mesh.points), 3))
    return MedField("DEPL", "nodes", ("DX", "DY", "DZ"), ("um",) * 3, TIMES, values)


def in_cells(mesh: PrismMesh) -> MedField:
    values = np.random.default_rng(2).random((3, len(mesh.cells), 2))
    return MedField("SLIP", "cells", ("S1", "S2"), ("", "rad"), TIMES, values)


def test_gauss_stresses_of_code_aster_are_those_of_its_own_table(element: Path) -> None:
    stress = read_med_fields(element)["U_______SIEF_ELGA"]
    table = np.load(DATA / "solver" / "code_aster_point.npz")
    expected = table[table.files[0]]
    assert stress.place == "points"
    assert stress.components == ("SIXX", "SIYY", "SIZZ", "SIXY", "SIXZ", "SIYZ")
    assert stress.values.shape == (61, 1, 8, 6)
    assert stress.ids.tolist() == [0]
    np.testing.assert_allclose(stress.weights, np.ones(8))  # of the cube from −1 to 1
    rows = np.searchsorted(stress.times, expected[:, 0] - 1e-6)
    np.testing.assert_allclose(stress.times[rows], expected[:, 0], atol=1e-9)
    for point in range(8):
        found = stress.values[rows, 0, point]
        np.testing.assert_allclose(found, expected[:, 2:], atol=1e-9 * abs(expected).max())


def test_nodal_values_stand_at_their_node_component_and_instant(element: Path) -> None:
    """MED keeps a field component by component: seen in the raw file."""
    field = read_med_fields(element, ["U_______DEPL"])["U_______DEPL"]
    with h5py.File(element) as file:
        steps = list(file["CHA/U_______DEPL"].values())
        raw = [step["NOE/MED_NO_PROFILE_INTERNAL/CO"][()].reshape(3, 8).T for step in steps]
        times = [step.attrs["PDT"] for step in steps]
    assert (field.place, field.components, field.units) == ("nodes", ("DX", "DY", "DZ"), ("",) * 3)
    assert field.times.tolist() == times
    assert abs(field.values[-1]).max() > 1e-3
    np.testing.assert_array_equal(field.values, raw)
    np.testing.assert_array_equal(field.ids, np.arange(8))


def test_fields_make_the_round_trip_and_leave_the_mesh_as_it_was(
    mesh: PrismMesh, med: Path
) -> None:
    written = (nodal(mesh), in_cells(mesh))
    add_med_fields(med, written)
    found = read_med_fields(med)
    assert list(found) == ["DEPL", "SLIP"]
    for field in written:
        read = found[field.name]
        assert (read.place, read.components) == (field.place, field.components)
        assert read.units == field.units
        np.testing.assert_array_equal(read.times, field.times)
        np.testing.assert_array_equal(read.values, field.values)
        np.testing.assert_array_equal(read.ids, np.arange(field.values.shape[1]))
    again = read_med(med)
    np.testing.assert_array_equal(again.cells, mesh.cells)
    np.testing.assert_array_equal(again.grain, mesh.grain)


def test_a_field_on_a_part_of_the_cells_says_on_which(mesh: PrismMesh, med: Path) -> None:
    part = np.array([3, 5, 8])
    file = mc.MEDFileUMesh(str(med))
    one = mc.MEDCouplingFieldDouble(mc.ON_CELLS, mc.ONE_TIME)
    one.setName("SKIN")
    one.setMesh(file.getMeshAtLevel(0)[part.tolist()])
    one.setArray(mc.DataArrayDouble([1.0, 2.0, 3.0]))
    profile = mc.DataArrayInt64(part)
    profile.setName("part")
    series = mc.MEDFileFieldMultiTS()
    series.appendFieldProfile(one, file, 0, profile)
    series.write(str(med), 0)
    found = read_med_fields(med)["SKIN"]
    assert found.ids.tolist() == [3, 5, 8]
    assert found.values.tolist() == [[[1.0], [2.0], [3.0]]]


def test_a_missing_field_is_told_beside_those_that_are_there(element: Path) -> None:
    with pytest.raises(
        ValueError, match=r"element\.rmed: found no field DEPL; it has U_______DEPL, U_"
    ):
        read_med_fields(element, ["DEPL"])


def test_a_mesh_without_fields_has_none(med: Path) -> None:
    assert read_med_fields(med) == {}


@pytest.mark.parametrize("content", ["empty", "half", "text"])
def test_a_damaged_file_is_refused_by_name(
    element: Path, content: str, capfd: pytest.CaptureFixture[str]
) -> None:
    whole = element.read_bytes()
    damaged = {"empty": b"", "half": whole[: len(whole) // 2], "text": b"NODES 1 2 3\n" * 50}
    element.write_bytes(damaged[content])
    with pytest.raises(ValueError, match=r"element\.rmed: not a MED file, or a damaged one"):
        read_med_fields(element)
    assert capfd.readouterr() == ("", "")


def test_an_absent_file_is_told(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"absent\.rmed: no such file"):
        read_med_fields(tmp_path / "absent.rmed")


def test_values_that_do_not_fit_the_mesh_are_refused(mesh: PrismMesh, med: Path) -> None:
    wrong = MedField("DEPL", "nodes", ("DX",), ("",), TIMES, np.zeros((3, 7, 1)))
    expected = (
        rf"field DEPL at nodes has the shape \(3, 7, 1\); expected \(3, {len(mesh.points)}, 1\)"
    )
    with pytest.raises(ValueError, match=expected):
        add_med_fields(med, [wrong])
