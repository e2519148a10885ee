"""MED meshes of other writers and versions, against h5py's reading of the same file."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import h5py
import medcoupling as mc
import meshio
import numpy as np
import pytest

from meshes.cells import jacobians
from meshes.files import read_med, write_med
from meshes.med_fields import read_med_fields
from meshes.prism_mesh import FACE_GROUPS, PrismMesh
from meshes.tet10 import MIRRORED
from tests.meshes import raw_med
from tests.meshes.gmsh_files import BOUNDARY, gmsh_prism
from tests.meshes.old_med import write_old_med
from tests.meshes.places import DEPTH, group_masks

VERSIONS: dict[tuple[int, int], Callable[[mc.MEDFileUMesh, str], None]] = {
    (3, 0): lambda file, path: file.write30(path, 2),
    (3, 3): lambda file, path: file.write33(path, 2),
    (4, 0): lambda file, path: file.write40(path, 2),
    (4, 1): lambda file, path: file.write41(path, 2),
}


@pytest.fixture(scope="module")
def gmsh_med(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("gmsh") / "gmsh.med"
    gmsh_prism(path)
    return path


def require_same(read: PrismMesh, path: Path, name: str) -> None:
    """The mesh is that of the file, seen by h5py alone."""
    np.testing.assert_array_equal(read.points, raw_med.coordinates(path, name))
    cells = raw_med.connectivity(path, name, "T10")
    turned = cells[:, MIRRORED]
    same = (read.cells == cells).all(axis=1) | (read.cells == turned).all(axis=1)
    assert same.all() and len(same) == len(cells)
    for grain in range(read.n_grains):
        found = raw_med.members(path, name, "T10", f"GRAIN{grain + 1}")
        np.testing.assert_array_equal(np.flatnonzero(read.grain == grain), found)
    triangles = raw_med.connectivity(path, name, "TR6")
    for group in FACE_GROUPS:
        found = raw_med.members(path, name, "TR6", group)
        assert found.size
        np.testing.assert_array_equal(read.faces[group], triangles[found])


def test_a_prism_of_gmsh_is_read_with_its_points_and_edges_left_out(gmsh_med: Path) -> None:
    assert {"PO1", "SE3"} < raw_med.kinds(gmsh_med, "prism")
    read = read_med(gmsh_med)
    require_same(read, gmsh_med, "prism")
    assert jacobians(read.points, read.cells).min() > 0
    volume = jacobians(read.points, read.cells)[:, 4].sum() / 6
    assert volume == pytest.approx(48 * np.sqrt(3))
    middle = read.points[read.cells].mean(axis=1)
    np.testing.assert_array_equal(read.grain, middle[:, 1] > BOUNDARY)
    for group, expected in group_masks(np.round(read.points, 9)).items():
        np.testing.assert_array_equal(read.nodes[group], np.flatnonzero(expected))
    assert read.points[read.nodes["P_PLUS"][0]] == pytest.approx([0, 12, -DEPTH])


def test_a_prism_of_meshio_is_read_though_its_cells_are_in_the_order_of_vtk(
    mesh: PrismMesh, tmp_path: Path
) -> None:
    path = tmp_path / "meshio.med"
    sizes = [len(faces) for faces in mesh.faces.values()]
    written = meshio.Mesh(
        mesh.points,
        [("tetra10", mesh.cells), ("triangle6", np.concatenate(list(mesh.faces.values())))],
        cell_data={"cell_tags": [-1 - mesh.grain, np.repeat([-11, -12, -13], sizes)]},
    )
    written.cell_tags = {-1: ["GRAIN1"], -2: ["GRAIN2"]}
    written.cell_tags |= {-11 - k: [name] for k, name in enumerate(mesh.faces)}
    meshio.write(path, written)
    np.testing.assert_array_equal(raw_med.connectivity(path, "mesh", "T10"), mesh.cells)
    read = read_med(path)
    require_same(read, path, "mesh")
    np.testing.assert_array_equal(read.cells, mesh.cells)


def test_faces_of_no_group_change_nothing(gmsh_med: Path, tmp_path: Path) -> None:
    path = tmp_path / "everything.med"
    gmsh_prism(path, everything=True)
    assert (raw_med.families(path, "prism", "TR6").size) > (
        raw_med.families(gmsh_med, "prism", "TR6").size
    )
    require_same(read_med(path), path, "prism")


@pytest.mark.parametrize("version", VERSIONS)
def test_every_version_since_3_is_read(
    gmsh_med: Path, tmp_path: Path, version: tuple[int, int]
) -> None:
    path = tmp_path / "version.med"
    VERSIONS[version](mc.MEDFileUMesh(str(gmsh_med)), str(path))
    assert raw_med.version(path) == version
    require_same(read_med(path), path, "prism")


def test_version_2_is_read_with_its_fields(gmsh_med: Path, tmp_path: Path) -> None:
    path = tmp_path / "old.med"
    n = len(raw_med.coordinates(gmsh_med, "prism"))
    nodal = {0.5: np.random.default_rng(1).random((n, 3)), 2.25: np.ones((n, 3))}
    write_old_med(gmsh_med, "prism", path, nodal)
    assert raw_med.version(path) == (2, 3)
    require_same(read_med(path), gmsh_med, "prism")
    field = read_med_fields(path)["DEPL"]
    assert (field.place, field.components, field.units) == ("nodes", ("DX", "DY", "DZ"), ("",) * 3)
    np.testing.assert_array_equal(field.times, list(nodal))
    np.testing.assert_array_equal(field.values, list(nodal.values()))


def test_of_several_meshes_the_one_with_the_groups_is_read(gmsh_med: Path, tmp_path: Path) -> None:
    path, bare = tmp_path / "several.med", tmp_path / "bare.med"
    path.write_bytes(gmsh_med.read_bytes())
    file = mc.MEDFileUMesh(str(gmsh_med))
    file.removeGroup("TOP")
    file.write41(str(bare), 2)
    raw_med.copy_mesh(bare, "prism", path, "a_first_one")
    require_same(read_med(path), path, "prism")


def test_a_mesh_is_chosen_by_name_where_several_have_the_groups(
    gmsh_med: Path, tmp_path: Path
) -> None:
    path, fine = tmp_path / "several.med", tmp_path / "everything.med"
    path.write_bytes(gmsh_med.read_bytes())
    gmsh_prism(fine, "with all faces", everything=True)
    raw_med.copy_mesh(fine, "with all faces", path, "with all faces")
    with pytest.raises(ValueError) as error:
        read_med(path)
    assert str(error.value) == (
        f"{path}: found the meshes prism, with all faces, 2 of them with GRAIN1, S_PLUS, S_MINUS, "
        "TOP; expected one, or the name of the wanted mesh"
    )
    for name in ("prism", "with all faces"):
        require_same(read_med(path, name), path, name)
    with pytest.raises(ValueError, match="meshes prism, with all faces, expected fine"):
        read_med(path, "fine")


def test_none_of_several_meshes_with_the_groups_is_told(gmsh_med: Path, tmp_path: Path) -> None:
    path = tmp_path / "linear.med"
    gmsh_prism(path, order=1)
    raw_med.copy_mesh(path, "prism", path, "second")
    with h5py.File(path, "r+") as hdf:
        for mesh in ("prism", "second"):
            del hdf[f"FAS/{mesh}/ELEME"]
    with pytest.raises(ValueError, match="prism, second, none of them with GRAIN1, S_PLUS"):
        read_med(path)


def test_a_mesh_that_changes_in_time_is_read_in_its_first_state(
    gmsh_med: Path, tmp_path: Path
) -> None:
    path = tmp_path / "moving.med"
    path.write_bytes(gmsh_med.read_bytes())
    with h5py.File(path, "r+") as hdf:
        mesh = hdf["ENS_MAA/prism"]
        (first,) = mesh
        later = f"{2:020d}{0:020d}"
        hdf.copy(mesh[first], mesh, later)
        for place, notes in (
            (mesh[later], {"NDT": 2, "NOR": 0, "PDT": 2.0}),
            (mesh[first], {"NXT": 2, "NXI": 0}),
            (mesh, {"NXT": 2, "NXI": 0}),
        ):
            for note, value in notes.items():
                place.attrs.modify(note, value)
        mesh[later]["NOE/COO"][...] += 1.0
    np.testing.assert_array_equal(read_med(path).points, raw_med.coordinates(gmsh_med, "prism"))


def test_groups_of_nodes_stand_for_the_faces_between_them(mesh: PrismMesh, tmp_path: Path) -> None:
    path = tmp_path / "nodes.med"
    write_med(replace(mesh, faces={}), path)
    assert raw_med.kinds(path, "prism") == {"T10"}
    read = read_med(path)
    np.testing.assert_array_equal(read.points, mesh.points)
    for group in FACE_GROUPS:
        ours, theirs = ({frozenset(face) for face in m.faces[group]} for m in (mesh, read))
        assert ours == theirs
        np.testing.assert_array_equal(read.nodes[group], mesh.nodes[group])


def test_a_group_of_nodes_between_which_no_face_is_is_refused(
    mesh: PrismMesh, tmp_path: Path
) -> None:
    path = tmp_path / "few.med"
    nodes = {**mesh.nodes, "TOP": mesh.nodes["TOP"][:2]}
    write_med(replace(mesh, faces={}, nodes=nodes), path)
    with pytest.raises(
        ValueError, match="group TOP of 2 nodes stands for no faces; expected a group of faces"
    ):
        read_med(path)


def test_linear_cells_of_gmsh_are_refused_by_their_kind(tmp_path: Path) -> None:
    gmsh_prism(tmp_path / "linear.med", order=1)
    with pytest.raises(
        ValueError,
        match=r"linear\.med: found cells TETRA4 with faces TRI3; quadratic cells are expected "
        r"\(TETRA10 with TRI6 faces",
    ):
        read_med(tmp_path / "linear.med")


def test_cells_with_nodes_that_the_file_lacks_are_refused(gmsh_med: Path, tmp_path: Path) -> None:
    path = tmp_path / "lacking.med"
    path.write_bytes(gmsh_med.read_bytes())
    n = len(raw_med.coordinates(path, "prism"))
    with h5py.File(path, "r+") as hdf:
        raw_med.state(hdf, "prism")["MAI/T10/NOD"][7] = n + 5
    with pytest.raises(ValueError, match=rf"cells with the nodes 1 to {n + 5}, expected 1 to {n}"):
        read_med(path)


def test_all_groups_are_named_where_one_is_missing(gmsh_med: Path, tmp_path: Path) -> None:
    path = tmp_path / "named.med"
    file = mc.MEDFileUMesh(str(gmsh_med))
    file.changeGroupName("GRAIN1", "grain_1")
    file.write40(str(path), 2)
    with pytest.raises(ValueError) as error:
        read_med(path)
    assert str(error.value) == (
        f"{path}: missing groups GRAIN1; the file has GRAIN2, grain_1 of cells, S_MINUS, S_PLUS, "
        "TOP of faces and none of nodes"
    )
