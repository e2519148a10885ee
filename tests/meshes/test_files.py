"""MED both ways, against medcoupling and a file that Code_Aster ran; VTU; refusals."""

import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import medcoupling as mc
import meshio
import numpy as np
import pytest
from numpy.typing import NDArray

from meshes.cells import jacobians
from meshes.files import read_med, write_med, write_vtu
from meshes.prism import PrismGeometry, generate
from meshes.prism_mesh import PrismMesh
from tests.meshes import raw_med

CODE_ASTER = Path(__file__).parents[1] / "data" / "meshes" / "code_aster_prism.med"


def determinants(path: Path) -> NDArray[np.float64]:
    """Six times the signed volume of the tetrahedra as they stand in the file."""
    file = mc.MEDFileUMesh(str(path))
    cells = file.getDirectUndergroundSingleGeoTypeMesh(mc.NORM_TETRA10).getNodalConnectivity()
    corners = file.getCoords().toNumPyArray()[cells.toNumPyArray().reshape(-1, 10)[:, :4]]
    result: NDArray[np.float64] = np.linalg.det(corners[:, 1:] - corners[:, :1])
    return result


def edit(source: Path, target: Path, change: Callable[[Any], None]) -> Path:
    file = mc.MEDFileUMesh(str(source))
    change(file)
    file.write(str(target), 2)
    return target


def code_aster_with_our_names(folder: Path) -> Path:
    def rename(file: Any) -> None:
        file.changeGroupName("SPLUS", "S_PLUS")
        file.changeGroupName("SMINUS", "S_MINUS")

    return edit(CODE_ASTER, folder / "renamed.med", rename)


@pytest.fixture
def med(mesh: PrismMesh, tmp_path: Path) -> Path:
    path = tmp_path / "prism.med"
    write_med(mesh, path)
    return path


def same(a: PrismMesh, b: PrismMesh) -> bool:
    return (
        all(np.array_equal(getattr(a, k), getattr(b, k)) for k in ("points", "cells", "grain"))
        and a.faces.keys() == b.faces.keys()
        and a.nodes.keys() == b.nodes.keys()
        and all(np.array_equal(a.faces[name], b.faces[name]) for name in a.faces)
        and all(np.array_equal(a.nodes[name], b.nodes[name]) for name in a.nodes)
    )


def test_a_round_trip_through_med_changes_nothing(mesh: PrismMesh, med: Path) -> None:
    assert same(read_med(med), mesh)


def test_a_single_grain_makes_the_round_trip(tmp_path: Path) -> None:
    single = generate(PrismGeometry(), 3.0)
    write_med(single, tmp_path / "single.med")
    assert same(read_med(tmp_path / "single.med"), single)


def test_writing_twice_replaces_the_file(mesh: PrismMesh, med: Path) -> None:
    write_med(mesh, med)
    assert same(read_med(med), mesh)


@pytest.mark.parametrize("folder", ["absent", "caf\udce9"])
def test_a_file_that_cannot_be_written_is_told_with_its_name(
    mesh: PrismMesh, folder: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / folder / "mesh.med"
    with pytest.raises(OSError, match="No such file|not UTF-8") as refused:
        write_med(mesh, path)
    assert refused.value.filename == str(path)
    assert capfd.readouterr().err == ""


FULL = """
import resource, signal, sys
from pathlib import Path
from meshes.files import read_med, write_med
mesh = read_med(Path(sys.argv[1]))
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]), -1))
try:
    write_med(mesh, Path(sys.argv[1]).with_name("other.med"))
except OSError as error:
    print(error.filename)
"""


@pytest.mark.parametrize("space", [100, 10_000])
def test_where_no_space_is_left_the_file_is_named_and_the_process_lives(
    med: Path, space: int
) -> None:
    found = subprocess.run(
        [sys.executable, "-c", FULL, med, str(space)],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        capture_output=True,
        text=True,
        check=False,
    )
    told = f"{med.with_name('other.med')}\n"
    assert (found.returncode, found.stdout, found.stderr) == (0, told, "")


def test_the_file_holds_every_group_of_cells_faces_and_nodes(mesh: PrismMesh, med: Path) -> None:
    file = mc.MEDFileUMesh(str(med))
    assert file.getGroupsOnSpecifiedLev(0) == ("GRAIN1", "GRAIN2")
    assert file.getGroupsOnSpecifiedLev(-1) == ("S_MINUS", "S_PLUS", "TOP")
    for name, nodes in mesh.nodes.items():
        assert np.array_equal(file.getNodeGroupArr(name).toNumPyArray(), nodes)


def test_a_mesh_without_faces_is_written_with_every_group_of_nodes(
    mesh: PrismMesh, tmp_path: Path
) -> None:
    nodes = {**mesh.nodes, "MOVED": np.array([0, 3, 5])}
    write_med(replace(mesh, faces={}, nodes=nodes), tmp_path / "cells.med")
    file = mc.MEDFileUMesh(str(tmp_path / "cells.med"))
    assert file.getNonEmptyLevels() == (0,)
    for name, members in nodes.items():
        assert np.array_equal(file.getNodeGroupArr(name).toNumPyArray(), members)


def require_declared_families(path: Path, faces: tuple[str, ...]) -> None:
    """Readers ask for the family of every node and cell."""
    assert raw_med.kinds(path, "prism") == {"T10", *faces}
    declared = raw_med.declared_families(path, "prism")
    for kind in (None, "T10", *faces):
        assert set(raw_med.families(path, "prism", kind)) <= declared


def test_the_file_is_of_med_4_0(med: Path) -> None:
    assert raw_med.version(med) == (4, 0)


def test_groups_stand_in_declared_families(mesh: PrismMesh, med: Path) -> None:
    require_declared_families(med, ("TR6",))
    cells, nodes = (raw_med.groups(med, "prism", where) for where in ("ELEME", "NOEUD"))
    assert cells.keys() == {"GRAIN1", "GRAIN2", *mesh.faces}
    assert nodes.keys() == mesh.nodes.keys()
    for grain in (0, 1):
        found = raw_med.members(med, "prism", "T10", f"GRAIN{grain + 1}")
        np.testing.assert_array_equal(found, np.flatnonzero(mesh.grain == grain))
    triangles = raw_med.connectivity(med, "prism", "TR6")
    for name, faces in mesh.faces.items():
        found = raw_med.members(med, "prism", "TR6", name)
        np.testing.assert_array_equal(triangles[found], faces)
    of_node = raw_med.families(med, "prism")
    for name, members in mesh.nodes.items():
        np.testing.assert_array_equal(np.flatnonzero(np.isin(of_node, list(nodes[name]))), members)


def test_families_are_declared_without_faces_and_with_nodes_of_no_group(
    mesh: PrismMesh, tmp_path: Path
) -> None:
    path = tmp_path / "cells.med"
    moved = np.array([0, 3, 5])
    write_med(replace(mesh, faces={}, nodes={"MOVED": moved}), path)
    require_declared_families(path, ())
    assert raw_med.groups(path, "prism", "NOEUD").keys() == {"MOVED"}
    (number,) = raw_med.groups(path, "prism", "NOEUD")["MOVED"]
    np.testing.assert_array_equal(np.flatnonzero(raw_med.families(path, "prism") == number), moved)


def test_families_are_declared_without_any_group_of_nodes(mesh: PrismMesh, tmp_path: Path) -> None:
    path = tmp_path / "cells.med"
    write_med(replace(mesh, nodes={}), path)
    require_declared_families(path, ("TR6",))
    assert raw_med.groups(path, "prism", "NOEUD") == {}


def test_hexahedra_stand_in_declared_families(tmp_path: Path) -> None:
    path = tmp_path / "bricks.med"
    bricks = generate(PrismGeometry(), 3.0, "hex20")
    write_med(bricks, path)
    assert raw_med.version(path) == (4, 0)
    declared = raw_med.declared_families(path, "prism")
    for kind in (None, "H20", "QU8"):
        assert set(raw_med.families(path, "prism", kind)) <= declared
    assert raw_med.kinds(path, "prism") == {"H20", "QU8"}
    assert len(raw_med.members(path, "prism", "QU8", "TOP")) == len(bricks.faces["TOP"])


def test_our_cells_have_the_handedness_of_the_file_that_code_aster_ran(med: Path) -> None:
    assert (determinants(CODE_ASTER) < 0).all()
    assert (determinants(med) < 0).all()


def test_the_code_aster_mesh_is_read_with_positive_jacobians(tmp_path: Path) -> None:
    mesh = read_med(code_aster_with_our_names(tmp_path))
    assert len(mesh.cells) == 669
    assert np.unique(mesh.grain).tolist() == [0, 1]
    assert jacobians(mesh.points, mesh.cells).min() > 0
    assert determinants(CODE_ASTER).sum() / 6 == pytest.approx(-48 * np.sqrt(3))
    assert jacobians(mesh.points, mesh.cells)[:, 4].sum() / 6 == pytest.approx(48 * np.sqrt(3))
    assert mesh.points[mesh.nodes["P_MINUS"][0]] == pytest.approx([0, 0, -2 * np.sqrt(3)])
    assert set(mesh.points[mesh.nodes["L_PLUS"], 1]) == {12.0}


def test_a_file_in_vtk_order_is_read_all_the_same(
    mesh: PrismMesh, med: Path, tmp_path: Path
) -> None:
    def invert(file: Any) -> None:
        cells = file.getMeshAtLevel(0)
        cells.invertOrientationOfAllCells()
        file.setMeshAtLevel(0, cells)
        for grain in (0, 1):
            group = mc.DataArrayInt64(np.flatnonzero(mesh.grain == grain))
            group.setName(f"GRAIN{grain + 1}")
            file.addGroup(0, group)

    path = edit(med, tmp_path / "vtk.med", invert)
    assert (determinants(path) > 0).all()
    read = read_med(path)
    assert np.array_equal(
        read.points[read.cells].mean(axis=1), mesh.points[mesh.cells].mean(axis=1)
    )
    assert jacobians(read.points, read.cells).min() > 0


def test_missing_groups_are_named_beside_those_that_are_there() -> None:
    with pytest.raises(
        ValueError, match="missing groups S_PLUS, S_MINUS; the file has GRAIN1"
    ) as e:
        read_med(CODE_ASTER)
    assert str(CODE_ASTER) in str(e.value)


def test_a_file_that_is_no_med_mesh_is_refused_by_name(
    med: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    content = med.read_bytes()
    foreign = tmp_path / "foreign.h5"
    with h5py.File(foreign, "w") as hdf:
        hdf["images"] = np.zeros(3)
    hollow = tmp_path / "hollow.med"
    with h5py.File(hollow, "w") as hdf:
        hdf.create_group("ENS_MAA/mesh")
    for name, data in {
        "empty.med": b"",
        "half.med": content[: len(content) // 2],
        "cut.med": content[:-100],
        "text.med": b"NODES 1 2 3\n" * 50,
    }.items():
        (tmp_path / name).write_bytes(data)
    for name in ("empty.med", "half.med", "cut.med", "text.med", "foreign.h5", "hollow.med"):
        with pytest.raises(ValueError, match=f"{name}: not a MED file, or a damaged one"):
            read_med(tmp_path / name)
    assert capfd.readouterr() == ("", "")


def test_a_missing_file_is_told(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"absent\.med: no such file"):
        read_med(tmp_path / "absent.med")


def test_linear_cells_are_refused(med: Path, tmp_path: Path) -> None:
    path = tmp_path / "linear.med"
    mc.MEDFileUMesh(str(med)).quadraticToLinear().write(str(path), 2)
    with pytest.raises(ValueError, match="quadratic cells are expected"):
        read_med(path)


def test_a_cell_in_no_grain_is_refused(med: Path, tmp_path: Path) -> None:
    path = edit(med, tmp_path / "lacking.med", lambda file: file.removeGroup("GRAIN2"))
    with pytest.raises(ValueError, match=r"\d+ of \d+ cells are in no grain or in two"):
        read_med(path)


def test_grains_that_are_not_numbered_from_one_are_refused(med: Path, tmp_path: Path) -> None:
    path = edit(med, tmp_path / "g.med", lambda file: file.changeGroupName("GRAIN2", "GRAIN7"))
    with pytest.raises(ValueError, match="expected as GRAIN1, GRAIN2"):
        read_med(path)


def test_inverted_cells_are_refused(med: Path, tmp_path: Path) -> None:
    def fold(file: Any) -> None:
        cells = file.getDirectUndergroundSingleGeoTypeMesh(mc.NORM_TETRA10)
        mid_edge = int(cells.getNodalConnectivity().toNumPyArray()[4])
        file.getCoords().toNumPyArray()[mid_edge] += 50.0

    with pytest.raises(ValueError, match=r"\d+ of \d+ cells have a Jacobian ≤ 0"):
        read_med(edit(med, tmp_path / "folded.med", fold))


def test_a_node_of_no_cell_is_refused(med: Path, tmp_path: Path) -> None:
    path = tmp_path / "loose.med"
    file = mc.MEDFileUMesh(str(med))
    coordinates = mc.DataArrayDouble.Aggregate(
        file.getCoords(), mc.DataArrayDouble([0.0, 0.0, 1.0], 1, 3)
    )
    more = mc.MEDFileUMesh()
    more.setName("prism")
    more.setCoords(coordinates)
    for level in (0, -1):
        cells = file.getMeshAtLevel(level)
        cells.setCoords(coordinates)
        more.setMeshAtLevel(level, cells)
        for name in file.getGroupsOnSpecifiedLev(level):
            more.addGroup(level, file.getGroupArr(level, name))
    more.write(str(path), 2)
    with pytest.raises(ValueError, match=r"1 of \d+ nodes belong to no cell"):
        read_med(path)


def test_vtu_holds_the_mesh_its_grains_and_the_fields(mesh: PrismMesh, tmp_path: Path) -> None:
    displacement = mesh.points * 0.01
    stress = np.arange(len(mesh.cells), dtype=float)
    path = tmp_path / "prism.vtu"
    write_vtu(mesh, path, {"U": displacement}, {"stress": stress})
    read = meshio.read(path)
    assert np.array_equal(read.points, mesh.points)
    assert np.array_equal(read.cells_dict["tetra10"], mesh.cells)
    assert np.array_equal(read.point_data["U"], displacement)
    assert np.array_equal(read.cell_data["stress"][0], stress)
    assert np.array_equal(read.cell_data["grain"][0], mesh.grain + 1)
