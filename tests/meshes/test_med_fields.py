"""Fields in MED files, against a result that Code_Aster wrote and by round trips."""

import gzip
from pathlib import Path
from typing import Any

import h5py
import medcoupling as mc
import numpy as np
import pytest

from meshes.files import read_med, write_med
from meshes.med_fields import MedField, add_med_fields, read_med_fields
from meshes.prism_mesh import PrismMesh
from tests.meshes import raw_med

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


def test_a_field_at_a_part_of_the_nodes_says_at_which(mesh: PrismMesh, med: Path) -> None:
    file = mc.MEDFileUMesh(str(med))
    part = file.getMeshAtLevel(0)[[3, 5, 8]]
    nodes = part.computeFetchedNodeIds()
    part.zipCoords()
    one = mc.MEDCouplingFieldDouble(mc.ON_NODES, mc.ONE_TIME)
    one.setName("PART")
    one.setMesh(part)
    one.setArray(mc.DataArrayDouble(np.random.default_rng(4).random(len(nodes))))
    nodes.setName("part")
    series = mc.MEDFileFieldMultiTS()
    series.appendFieldProfile(one, file, 0, nodes)
    series.write40(str(med), 0)
    found = read_med_fields(med)["PART"]
    np.testing.assert_array_equal(found.ids, np.unique(mesh.cells[[3, 5, 8]]))
    with h5py.File(med) as hdf:
        (profile,) = hdf["PROFILS"].values()
        np.testing.assert_array_equal(found.ids, profile["PFL"][()] - 1)
    (raw,) = raw_med.field(med, "PART", "NOE").values()
    np.testing.assert_array_equal(found.values[0], raw)


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


def write(path: Path, kind: int, level: int, values: Any, *, at: Any = ((0.0, 0, -1),)) -> None:
    """Write the field F of one component in all cells of a level or at all nodes.

    Args:
        path: the file.
        kind: of medcoupling, as mc.ON_CELLS.
        level: 0 for the volumes, -1 for the faces.
        values: DataArrayDouble or another one of medcoupling, the same at all instants.
        at: time and the two numbers of each instant.
    """
    series = {
        mc.DataArrayDouble: mc.MEDFileFieldMultiTS,
        mc.DataArrayInt32: mc.MEDFileInt32FieldMultiTS,
        mc.DataArrayInt64: mc.MEDFileInt64FieldMultiTS,
        mc.DataArrayFloat: mc.MEDFileFloatFieldMultiTS,
    }[type(values)]()
    one = {
        mc.DataArrayDouble: mc.MEDCouplingFieldDouble,
        mc.DataArrayInt32: mc.MEDCouplingFieldInt32,
        mc.DataArrayInt64: mc.MEDCouplingFieldInt64,
        mc.DataArrayFloat: mc.MEDCouplingFieldFloat,
    }[type(values)](kind, mc.ONE_TIME)
    one.setName("F")
    one.setMesh(mc.MEDFileUMesh(str(path)).getMeshAtLevel(level))
    one.setArray(values)
    for time, number, iteration in at:
        one.setTime(time, number, iteration)
        series.appendFieldNoProfileSBT(one)
    series.write41(str(path), 0)


def gauss_field(support: Any, where: dict[int, tuple[list[float], int]]) -> Any:
    """A field of one component at Gauss points: for each kind of cell weights and nodes of it."""
    one = mc.MEDCouplingFieldDouble(mc.ON_GAUSS_PT, mc.ONE_TIME)
    one.setName("G")
    one.setMesh(support)
    for kind, (weights, nodes) in where.items():
        points = np.linspace(0.1, 0.3, 3 * len(weights)).tolist()
        reference = np.arange(3.0 * nodes).tolist()
        one.setGaussLocalizationOnType(kind, reference, points, weights)
    one.setArray(mc.DataArrayDouble(np.arange(float(one.getNumberOfTuplesExpected()))))
    return one


@pytest.mark.parametrize("array", [mc.DataArrayInt32, mc.DataArrayInt64, mc.DataArrayFloat])
def test_whole_numbers_and_short_reals_are_read_as_reals(
    mesh: PrismMesh, med: Path, array: Any
) -> None:
    write(med, mc.ON_NODES, 0, array(list(range(len(mesh.points)))))
    field = read_med_fields(med)["F"]
    assert field.values.dtype == np.float64
    (raw,) = raw_med.field(med, "F", "NOE").values()
    assert raw.dtype != np.float64
    np.testing.assert_array_equal(field.values[0], raw)


def test_values_at_the_nodes_of_cells_stand_at_their_cell_and_node(
    mesh: PrismMesh, med: Path
) -> None:
    n = len(mesh.cells)
    write(med, mc.ON_GAUSS_NE, 0, mc.DataArrayDouble(np.random.default_rng(3).random(10 * n)))
    field = read_med_fields(med)["F"]
    (raw,) = raw_med.field(med, "F", "NOE.T10").values()
    assert field.place == "cell nodes"
    np.testing.assert_array_equal(field.values[0], raw.reshape(n, 10, 1))
    np.testing.assert_array_equal(field.ids, np.arange(n))


def test_every_iteration_of_an_instant_is_read(mesh: PrismMesh, med: Path) -> None:
    at = ((0.0, 0, 0), (2.5, 1, 1), (2.5, 1, 2), (4.0, 2, 0))
    write(med, mc.ON_CELLS, 0, mc.DataArrayDouble([1.0] * len(mesh.cells)), at=at)
    field = read_med_fields(med)["F"]
    assert list(raw_med.field(med, "F", "MAI.T10")) == [(n, it, t) for t, n, it in at]
    np.testing.assert_array_equal(field.times, [0.0, 2.5, 2.5, 4.0])
    assert field.values.shape == (4, len(mesh.cells), 1)


def test_a_field_of_faces_is_left_out_and_refused_by_name(mesh: PrismMesh, med: Path) -> None:
    n = sum(len(faces) for faces in mesh.faces.values())
    write(med, mc.ON_CELLS, -1, mc.DataArrayDouble([1.0] * n))
    assert read_med_fields(med) == {}
    with pytest.raises(ValueError, match=r"prism\.med: found the fields F on faces or edges alone"):
        read_med_fields(med, ["F"])


def test_values_on_the_faces_do_not_hide_those_of_the_cells(mesh: PrismMesh, med: Path) -> None:
    n = sum(len(faces) for faces in mesh.faces.values())
    file = mc.MEDFileUMesh(str(med))
    at_points = gauss_field(file.getMeshAtLevel(0), {mc.NORM_TETRA10: ([0.25, 0.75], 10)})
    on_faces = mc.MEDCouplingFieldDouble(mc.ON_CELLS, mc.ONE_TIME)
    on_faces.setName("G")
    on_faces.setMesh(file.getMeshAtLevel(-1))
    on_faces.setArray(mc.DataArrayDouble([-1.0] * n))
    one = mc.MEDFileField1TS()
    one.setFieldNoProfileSBT(at_points)
    one.setFieldNoProfileSBT(on_faces)
    one.write40(str(med), 0)
    field = read_med_fields(med)["G"]
    (raw,) = raw_med.field(med, "G", "MAI.T10").values()
    assert field.place == "points"
    np.testing.assert_array_equal(field.values[0], raw.reshape(len(mesh.cells), 2, 1))
    assert field.weights.tolist() == [0.25, 0.75]


def test_gauss_points_of_several_kinds_are_refused(tmp_path: Path) -> None:
    """One hexahedron of 8 points and one wedge of 6 are no two cells of 7."""
    path = tmp_path / "mixed.med"
    cells = mc.MEDCouplingUMesh("mixed", 3)
    corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (2, 0, 0)]
    points = [(float(x), float(y), float(z + dz)) for dz in (0, 1) for x, y, z in corners]
    cells.setCoords(mc.DataArrayDouble(points))
    cells.allocateCells(2)
    cells.insertNextCell(mc.NORM_PENTA6, [1, 4, 2, 6, 9, 7])
    cells.insertNextCell(mc.NORM_HEXA8, [0, 1, 2, 3, 5, 6, 7, 8])
    file = mc.MEDFileUMesh()
    file.setMeshAtLevel(0, cells)
    file.write40(str(path), 2)
    kinds = {mc.NORM_PENTA6: ([1.0] * 6, 6), mc.NORM_HEXA8: ([1.0] * 8, 8)}
    one = mc.MEDFileField1TS()
    one.setFieldNoProfileSBT(gauss_field(cells, kinds))
    one.write40(str(path), 0)
    write(path, mc.ON_GAUSS_NE, 0, mc.DataArrayDouble([1.0] * 14))
    with pytest.raises(ValueError, match=r"mixed\.med: field G has values at several kinds of po"):
        read_med_fields(path, ["G"])
    with pytest.raises(
        ValueError,
        match="F has values at several kinds of cell nodes, HEXA8, PENTA6; expected one kind",
    ):
        read_med_fields(path, ["F"])


def test_a_field_at_other_places_later_is_refused(mesh: PrismMesh, med: Path) -> None:
    write(med, mc.ON_CELLS, 0, mc.DataArrayDouble([1.0] * len(mesh.cells)))
    with h5py.File(med, "r+") as hdf:
        hdf.copy("CHA/F", hdf["CHA"], "G")
    write_later = mc.MEDFileFieldMultiTS(str(med), "G")
    one = mc.MEDCouplingFieldDouble(mc.ON_NODES, mc.ONE_TIME)
    one.setName("G")
    one.setMesh(mc.MEDFileUMesh(str(med)).getMeshAtLevel(0))
    one.setArray(mc.DataArrayDouble([1.0] * len(mesh.points)))
    one.setTime(1.0, 1, -1)
    write_later.appendFieldNoProfileSBT(one)
    write_later.write40(str(med), 0)
    with pytest.raises(ValueError, match="field G has values at other places at other instants"):
        read_med_fields(med, ["G"])


def test_fields_are_read_from_the_mesh_that_has_them(mesh: PrismMesh, med: Path) -> None:
    raw_med.copy_mesh(med, "prism", med, "a_first_one")
    write_on = mc.MEDFileUMesh(str(med), "prism")
    one = mc.MEDCouplingFieldDouble(mc.ON_CELLS, mc.ONE_TIME)
    one.setName("F")
    one.setMesh(write_on.getMeshAtLevel(0))
    one.setArray(mc.DataArrayDouble([2.0] * len(mesh.cells)))
    series = mc.MEDFileFieldMultiTS()
    series.appendFieldNoProfileSBT(one)
    series.write40(str(med), 0)
    for found in (read_med_fields(med), read_med_fields(med, ["F"], "prism")):
        np.testing.assert_array_equal(found["F"].values, np.full((1, len(mesh.cells), 1), 2.0))
    assert read_med_fields(med, mesh="a_first_one") == {}
    with pytest.raises(ValueError, match="found no field F; it has no fields"):
        read_med_fields(med, ["F"], "a_first_one")


def test_a_damaged_field_is_one_sentence(element: Path, capfd: pytest.CaptureFixture[str]) -> None:
    with h5py.File(element, "r+") as hdf:
        for instant in hdf["CHA/U_______SIEF_ELGA"].values():
            for place in instant.values():
                place.attrs["GAU"] = np.bytes_(b"")
                for values in place.values():
                    values.attrs["GAU"] = np.bytes_(b"")
    with pytest.raises(ValueError, match=r"element\.rmed: its field U_______SIEF_ELGA cannot be r"):
        read_med_fields(element)
    assert capfd.readouterr() == ("", "")
    assert read_med_fields(element, ["U_______DEPL"])["U_______DEPL"].values.shape == (61, 8, 3)
