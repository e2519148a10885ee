"""Meshes of a user's own: what they are read as, and one sentence for each fault."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from meshes.cells import inverted_cells, jacobians
from meshes.files import write_med
from meshes.grain_boundary import GrainBoundary
from meshes.prism import PrismGeometry, generate
from meshes.prism_mesh import PrismMesh
from meshes.uniform_split import in_pieces
from meshes.user_mesh import measures_of, read_user_mesh
from tests.meshes.gmsh_files import gmsh_prism
from tests.meshes.user_files import DEPTH, LENGTH, WIDTH, gmsh_bar, write_as_vtu

GEOMETRY = PrismGeometry(
    8.0, 4.0, 3.0, (GrainBoundary((0.0, 4.0, 0.0), (0.1, 1.0, 0.2)),), bottom=3.0
)


@cache
def own(kind: str) -> PrismMesh:
    """A mesh of the program's own."""
    return generate(GEOMETRY, 2.5, "tet10" if kind == "tet10" else "hex20")


def nothing(data: dict[str, Any]) -> None:
    """Leave a file as it is."""


@pytest.mark.parametrize("ending", [".msh", ".med"])
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("hexahedra", [False, True])
def test_a_bar_that_gmsh_has_written_has_its_measures_grains_and_faces(
    tmp_path: Path, ending: str, order: int, hexahedra: bool
) -> None:
    path = tmp_path / f"bar{ending}"
    gmsh_bar(path, order, hexahedra)
    mesh = read_user_mesh(path)
    found = measures_of(mesh)
    sides = (found.length, found.width, found.depth, found.area)
    np.testing.assert_allclose(sides, (LENGTH, WIDTH, DEPTH, WIDTH * DEPTH), rtol=1e-12)
    assert found.kind == ("hex20" if hexahedra else "tet10")
    assert found.n_grains == 2
    assert not len(inverted_cells(mesh.points, mesh.cells))
    low = mesh.points[mesh.cells[mesh.grain == 0], 1].max()
    assert (low, mesh.points[mesh.cells[mesh.grain == 1], 1].min()) == pytest.approx((4.0, 4.0))
    assert {name: np.unique(mesh.points[mesh.nodes[name], axis]).tolist() for name, axis in (
        ("S_MINUS", 1), ("S_PLUS", 1), ("TOP", 2))} == {
        "S_MINUS": [0.0], "S_PLUS": [LENGTH], "TOP": [0.0]}  # fmt: skip


def test_a_prism_by_gmsh_in_med_has_the_triangle_as_its_section(tmp_path: Path) -> None:
    gmsh_prism(tmp_path / "prism.med")
    found = measures_of(read_user_mesh(tmp_path / "prism.med"))
    assert found.area == pytest.approx(4 * np.sqrt(3), rel=1e-12)


@pytest.mark.parametrize("kind", ["tet10", "hex20"])
@pytest.mark.parametrize("ending", [".med", ".vtu"])
def test_a_mesh_of_the_program_comes_back_node_for_node(
    tmp_path: Path, kind: str, ending: str
) -> None:
    mesh, path = own(kind), tmp_path / f"own{ending}"
    if ending == ".med":
        write_med(mesh, path)
    else:
        write_as_vtu(path, mesh, nothing)
    read = read_user_mesh(path)
    np.testing.assert_allclose(read.points[read.cells], mesh.points[mesh.cells], rtol=0, atol=1e-14)
    np.testing.assert_array_equal(read.grain, mesh.grain)
    assert {name: len(faces) for name, faces in read.faces.items()} == {
        name: len(faces) for name, faces in mesh.faces.items()
    }


@pytest.mark.parametrize("kind", ["tet10", "hex20"])
@pytest.mark.parametrize("pieces", [2, 3])
def test_a_mesh_in_pieces_is_the_same_specimen_in_conforming_cells(kind: str, pieces: int) -> None:
    mesh = own(kind)
    finer = in_pieces(mesh, pieces)
    assert len(finer.cells) == pieces**3 * len(mesh.cells)
    assert jacobians(finer.points, finer.cells).min() > 0
    whole, parts = measures_of(mesh), measures_of(finer)
    assert (parts.length, parts.width, parts.depth) == (whole.length, whole.width, whole.depth)
    assert parts.area == pytest.approx(whole.area, rel=1e-12)
    for name, faces in mesh.faces.items():
        # Whole faces on the outside, none inside: neighbours part a common face alike.
        assert len(finer.faces[name]) == pieces**2 * len(faces)
    np.testing.assert_array_equal(np.bincount(finer.grain), pieces**3 * np.bincount(mesh.grain))
    places = {tuple(at) for at in np.round(finer.points, 9)}
    assert len(places) == len(finer.points)
    corners = mesh.points[np.unique(mesh.cells[:, : 4 if kind == "tet10" else 8])]
    assert {tuple(at) for at in np.round(corners, 9)} <= places


def hang(data: dict[str, Any]) -> None:
    """Part the tetrahedron at the first inner face in two, and leave its neighbour whole."""
    cells = data["cells"]["tetra10"]
    first = cells[0]
    middle = data["points"][first[:2]].mean(axis=0)
    data["points"] = np.concatenate([data["points"], [middle]])
    node = len(data["points"]) - 1
    one, other = first[:4].copy(), first[:4].copy()
    one[1], other[0] = node, node
    linear = np.concatenate([cells[1:, :4], [one, other]])
    data["cells"] = {"tetra": linear}
    data["grain"] = np.concatenate([data["grain"][1:], data["grain"][[0, 0]]])
    for name, inside in data["nodes"].items():
        both = inside[first[0]] and inside[first[1]]
        data["nodes"][name] = np.concatenate([inside, [both]])


def part(data: dict[str, Any]) -> None:
    """Give the second grain nodes of its own."""
    cells, n = data["cells"]["tetra10"], len(data["points"])
    cells[data["grain"] == 2] += n
    data["points"] = np.concatenate([data["points"]] * 2)
    data["nodes"] = {name: np.concatenate([inside] * 2) for name, inside in data["nodes"].items()}


def change(key: str, value: Callable[[Any], Any]) -> Callable[[dict[str, Any]], None]:
    """Return what changes an entry of a file."""

    def changed(data: dict[str, Any]) -> None:
        data[key] = value(data[key])

    return changed


def flattened(cells: dict[str, Any]) -> dict[str, Any]:
    cells["tetra10"][3, 2] = cells["tetra10"][3, 4]
    return {"tetra": cells["tetra10"][:, :4]}


def moved(points: Any, *by: float) -> Any:
    return points + np.array(by)


FAULTS: dict[str, tuple[Callable[[dict[str, Any]], None], str]] = {
    "a group that is missing": (
        change("nodes", lambda nodes: {name: nodes[name] for name in ("S_PLUS", "TOP")}),
        "found the groups GRAIN1, GRAIN2 of cells and S_PLUS, TOP of faces or nodes, expected "
        "S_MINUS as well",
    ),
    "a cell in no grain": (
        change("grain", lambda grain: np.where(np.arange(grain.size) == 5, 0, grain)),
        "cells in no grain, expected each in one of GRAIN1, GRAIN2",
    ),
    "a number of a grain left out": (
        change("grain", lambda grain: np.where(grain == 2, 3, grain)),
        "found the grains GRAIN1, GRAIN3, expected GRAIN1, GRAIN2",
    ),
    "nodes twice at the interface": (part, "nodes at the place of another one, the first at ("),
    "a hanging node": (hang, "faces inside the specimen whose cells do not share all nodes"),
    "a flat cell": (change("cells", flattened), "cells with a Jacobian ≤ 0, the first at ("),
    "a face elsewhere than Z = 0": (
        change("points", lambda points: moved(points, 0, 0, 1.5)),
        "found TOP at Z = 1.5 µm, expected Z = 0",
    ),
    "a face that is no plane": (
        change("points", lambda points: points - np.outer(
            1e-3 * points[:, 0] ** 2, [0, 0, 1])),
        "found TOP with Z from -0.004 to ",
    ),
    "an end that is no plane": (
        change("points", lambda points: points + np.outer(
            0.02 * points[:, 2] * (points[:, 1] > 7.9), [0, 1, 0])),
        "found S_PLUS with Y from 7.94 to 8 µm, expected a plane face at the largest Y",
    ),
    "ends the other way round": (
        change("nodes", lambda nodes: nodes | {
            "S_PLUS": nodes["S_MINUS"], "S_MINUS": nodes["S_PLUS"]}),
        "found S_MINUS at Y = 8 µm of cells from 0 to 8 µm, expected it at the smallest Y",
    ),
    "an origin elsewhere along Y": (
        change("points", lambda points: moved(points, 0, -4, 0)),
        "found S_MINUS at Y = -4 µm, expected Y = 0",
    ),
    "an origin elsewhere along X": (
        change("points", lambda points: moved(points, 2, 0, 0)),
        "found TOP with X from 0 to 4 µm, expected -2 to 2: X = 0 is the middle of the measured "
        "face",
    ),
    "a face that looks down": (
        change("points", lambda points: points * [1, -1, -1] + [0, 8, 0]),
        "found S_MINUS at Y = 8 µm of cells from 0 to 8 µm, expected it at the smallest Y",
    ),
    "a part of a face": (
        change("nodes", lambda nodes: nodes | {
            "TOP": nodes["TOP"] * (np.arange(len(nodes["TOP"])) % 7 > 0)}),
        "nodes in the plane of TOP that are not in the group, the first at (",
    ),
    "a node of an edge elsewhere": (
        change("cells", lambda cells: {
            kind: np.roll(nodes, 1, axis=1) for kind, nodes in cells.items()}),
        "cells with a node of an edge far from its middle, the first at (",
    ),
    "cells of two kinds": (
        change("cells", lambda cells: {
            "tetra10": cells["tetra10"][:-1], "wedge": cells["tetra10"][-1:, :6]}),
        "found tetra10 and wedge, expected tetrahedra alone or hexahedra alone",
    ),
    "a cell twice": (
        lambda data: data.update(
            cells={"tetra10": np.concatenate([data["cells"]["tetra10"]] * 2)},
            grain=np.concatenate([data["grain"], 3 - data["grain"]]),
        ),
        "cells in two grains, expected each once, in one grain",
    ),
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_each_fault_is_refused_in_one_sentence(tmp_path: Path, fault: str) -> None:
    spoil, expected = FAULTS[fault]
    path = tmp_path / "specimen.vtu"
    write_as_vtu(path, own("tet10"), spoil)
    with pytest.raises(ValueError, match="^found ") as error:
        read_user_mesh(path)
    assert expected in str(error.value)


@pytest.mark.parametrize(
    ("name", "content", "expected"),
    [
        ("specimen.inp", b"", "found the ending .inp, expected a mesh with named groups"),
        ("specimen.msh", b"$MeshFormat\nno", "found no .msh file that can be read"),
        ("specimen.vtu", b"<VTKFile>", "found no .vtu file that can be read"),
        ("specimen.med", b"no", "not a MED file, or a damaged one"),
    ],
)
def test_a_file_that_cannot_be_read_is_refused_in_one_sentence(
    tmp_path: Path, name: str, content: bytes, expected: str
) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(ValueError) as error:
        read_user_mesh(path)
    assert str(error.value).startswith(expected)
