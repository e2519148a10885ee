"""Plane meshes read back from files that other programs wrote."""

from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np
import pytest

from meshes.gmsh_library import running_gmsh
from meshes.plane_cells import CellKind
from meshes.plane_files import read_plane_mesh
from tests.meshes.plane_examples import distorted

NAMES = {"tri3": "triangle", "tri6": "triangle6", "quad4": "quad", "quad8": "quad8"}
FORMATS = {".msh": "gmsh22", ".med": "med", ".vtu": "vtu"}


def area(path: Path) -> float:
    """Integral of 1 over all cells, by their own quadrature."""
    mesh = read_plane_mesh(path)
    at, weights = mesh.cell.quadrature
    maps = np.einsum("qai,cad->cqdi", mesh.cell.gradient(at), mesh.points[mesh.cells])
    return float((np.abs(np.linalg.det(maps)) * weights).sum())


@pytest.mark.parametrize("ending", FORMATS)
@pytest.mark.parametrize("kind", NAMES)
def test_every_kind_is_read_from_every_format(kind: CellKind, ending: str, tmp_path: Path) -> None:
    mesh, path = distorted(kind), tmp_path / f"face{ending}"
    points = np.column_stack([mesh.points, np.full(len(mesh.points), 0.7)])
    points = np.vstack([points, [5.0, 5.0, 0.7]])  # of no cell
    cells = [("line", mesh.cells[:1, :2]), (NAMES[kind], mesh.cells)]
    meshio.Mesh(points, cells).write(path, file_format=FORMATS[ending])
    found = read_plane_mesh(path)
    assert found.kind == kind
    assert found.points[found.cells] == pytest.approx(mesh.points[mesh.cells], abs=1e-12)
    assert len(found.points) == len(mesh.points)


@pytest.mark.parametrize(
    ("order", "quads", "kind"),
    [(1, False, "tri3"), (2, False, "tri6"), (1, True, "quad4"), (2, True, "quad8")],
)
def test_a_face_that_gmsh_itself_has_meshed_is_read(
    order: int, quads: bool, kind: str, tmp_path: Path
) -> None:
    with running_gmsh() as gmsh:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("Mesh.SecondOrderIncomplete", 1)
        gmsh.option.setNumber("Mesh.RecombineAll", float(quads))
        gmsh.option.setNumber("Mesh.MeshSizeMax", 1.0)
        gmsh.model.occ.addRectangle(-2, 0, 0, 4, 12)
        gmsh.model.occ.synchronize()
        gmsh.model.mesh.generate(2)
        gmsh.model.mesh.setOrder(order)
        gmsh.write(str(tmp_path / "face.msh"))
        gmsh.write(str(tmp_path / "no_groups.med"))
        gmsh.option.setNumber("Mesh.SaveParametric", 1)
        for version, binary in ((2.2, 0), (4.1, 0), (4.1, 1)):
            gmsh.option.setNumber("Mesh.MshFileVersion", version)
            gmsh.option.setNumber("Mesh.Binary", binary)
            gmsh.write(str(tmp_path / f"parametric_{version}_{binary}.msh"))
    for path in tmp_path.iterdir():
        assert read_plane_mesh(path).kind == kind, path.name
        assert area(path) == pytest.approx(48.0), path.name
    assert len(list(tmp_path.iterdir())) == 5


def write(path: Path, cells: list[tuple[str, np.ndarray]], z: float = 0.0) -> None:
    points = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, z], [2, 0, 0], [2, 1, 0]]
    meshio.Mesh(np.array(points, float), cells).write(path, file_format="gmsh22")


@pytest.mark.parametrize(
    ("cells", "z", "said"),
    [
        ([("tetra", np.array([[0, 1, 2, 3]]))], 1.0, "found cells of the kind tetra, expected"),
        (
            [("triangle", np.array([[0, 1, 2]])), ("quad", np.array([[1, 4, 5, 2]]))], 0.0,
            "found quad4 and tri3, expected .* all cells of one kind",
        ),
        ([("line", np.array([[0, 1]]))], 0.0, "found none of these cells, expected"),
        ([("quad", np.array([[0, 1, 2, 3]]))], 0.5, "differ by 0.5 µm in Z, expected a plane"),
        ([("quad", np.array([[0, 2, 1, 3]]))], 0.0, "found that cell 0 is folded or flat, expect"),
    ],
)  # fmt: skip
def test_another_mesh_is_refused_in_one_sentence(
    cells: list[tuple[str, np.ndarray]], z: float, said: str, tmp_path: Path
) -> None:
    write(tmp_path / "face.msh", cells, z)
    with pytest.raises(ValueError, match=said) as refused:
        read_plane_mesh(tmp_path / "face.msh")
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("face.stl", b"solid", "found the ending .stl, expected a plane mesh of tri3"),
        ("absent.msh", None, "found no such file"),
        ("face.msh", b"no mesh", "found no readable gmsh file"),
        ("face.med", b"no mesh", "found no readable med file"),
        ("face.vtu", b"<VTKFile", "found no readable vtu file"),
    ],
)
def test_a_bad_file_is_refused_in_one_sentence_and_nothing_is_printed(
    name: str, content: bytes | None, said: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(ValueError, match=said):
        read_plane_mesh(tmp_path / name)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("ending", [".msh", ".med"])
def test_a_script_of_gmsh_with_the_ending_of_a_mesh_is_not_run(ending: str, tmp_path: Path) -> None:
    trace, path = tmp_path / "trace", tmp_path / f"face{ending}"
    path.write_text(f'Point(1) = {{0, 0, 0}};\nSystemCall "touch {trace}";\n')
    with pytest.raises(ValueError, match="found no readable"):
        read_plane_mesh(path)
    assert not trace.exists()


def test_options_of_gmsh_beside_a_mesh_are_not_run(tmp_path: Path) -> None:
    trace, path = tmp_path / "trace", tmp_path / "face.msh"
    with running_gmsh() as gmsh:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("Mesh.SaveParametric", 1)
        gmsh.model.occ.addRectangle(-2, 0, 0, 4, 12)
        gmsh.model.occ.synchronize()
        gmsh.model.mesh.generate(2)
        gmsh.write(str(path))
    for name in ("face.msh.opt", "face.opt", "face.geo"):
        (tmp_path / name).write_text(f'SystemCall "touch {trace}";\n')
    assert read_plane_mesh(path).kind == "tri3"
    assert not trace.exists()
