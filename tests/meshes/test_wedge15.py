"""Meshes of fifteen-node wedges: Jacobians, volumes, conformity, groups, refusals."""

from dataclasses import replace
from pathlib import Path

import medcoupling as mc
import meshio
import numpy as np
import pytest
from numpy.typing import NDArray

from meshes.cells import EDGES, inverted_cells, jacobians
from meshes.files import read_med, write_med, write_vtu
from meshes.prism import PrismGeometry, generate
from meshes.prism_mesh import FACE_GROUPS, PrismMesh
from meshes.tet10 import outer_faces
from meshes.velocity import boundary_shift, moved
from meshes.wedge15 import MIRRORED
from tests.meshes.places import DEPTH, group_masks

CELL = np.arange(15)[None]
TILTED = PrismGeometry(boundary_point=(0, 5.4, 0), boundary_normal=(0.15, 1, 0.30))


@pytest.fixture(scope="module")
def wedges() -> PrismMesh:
    return generate(TILTED, 1.5, "wedge15")


def reference() -> NDArray[np.float64]:
    corners = np.array([[0, 0, -1], [1, 0, -1], [0, 1, -1], [0, 0, 1], [1, 0, 1], [0, 1, 1.0]])
    return np.concatenate([corners, corners[EDGES[15]].mean(axis=1)])


def test_jacobians_of_a_quadratic_map_are_exact() -> None:
    # x = r + 0.3 r² + 0.2 s t, y = 2 s + 0.1 r t, z = t: exact where the map is serendipity.
    r, s, t = reference().T
    points = np.column_stack([r + 0.3 * r**2 + 0.2 * s * t, 2 * s + 0.1 * r * t, t])
    third = 1 / 3
    at = np.array([*reference()[:6], [third, third, 0]])
    r, s, t = at.T
    expected = (1 + 0.6 * r) * 2 - 0.2 * t * 0.1 * t
    assert jacobians(points, CELL)[0] == pytest.approx(expected, rel=1e-14)


def test_a_wedge_of_the_other_handedness_is_noticed() -> None:
    other = np.array([[0, 2, 1, 3, 5, 4, 8, 7, 6, 11, 10, 9, 12, 14, 13]])
    assert len(inverted_cells(reference(), CELL)) == 0
    assert inverted_cells(reference(), other).tolist() == [0]


def test_the_cells_of_each_grain_fill_its_part_of_the_prism(wedges: PrismMesh) -> None:
    # The mean height of a plane over the section is its height at the centroid Z = −depth/3.
    volume = np.bincount(wedges.grain, jacobians(wedges.points, wedges.cells)[:, 6])
    first = 2 * DEPTH * (5.4 + 0.30 * DEPTH / 3)
    np.testing.assert_allclose(volume, [first, 24 * DEPTH - first], rtol=1e-12)
    assert jacobians(wedges.points, wedges.cells).min() > 0
    middle = wedges.points[wedges.cells[:, EDGES[15]]].mean(axis=2)
    np.testing.assert_allclose(wedges.points[wedges.cells[:, 6:]], middle, atol=1e-12)


def test_cells_meet_at_whole_faces_and_the_grains_at_the_boundary(wedges: PrismMesh) -> None:
    assert len(np.unique(wedges.points.round(9), axis=0)) == len(wedges.points)
    assert np.array_equal(np.unique(wedges.cells), np.arange(len(wedges.points)))
    shared = np.intersect1d(wedges.cells[wedges.grain == 0], wedges.cells[wedges.grain == 1])
    assert abs(TILTED.boundary_distance(wedges.points[shared])).max() < 1e-12
    # Divisions 3 and 8 layers: (n + 1)(2n + 1) nodes of a section, its corners between layers.
    assert len(wedges.cells) == 9 * 8
    assert len(wedges.points) == 28 * 9 + 10 * 8


def test_faces_point_outwards_and_groups_hold_the_nodes_of_their_place(wedges: PrismMesh) -> None:
    expected = {"S_PLUS": (0, 2 * DEPTH, 0), "S_MINUS": (0, -2 * DEPTH, 0), "TOP": (0, 0, 48)}
    assert set(wedges.faces) == set(FACE_GROUPS)
    for name, area in expected.items():
        face = wedges.faces[name]
        n = 3 if face.shape[1] == 6 else 4
        corner = wedges.points[face[:, :n]]
        fan = [
            np.cross(corner[:, i] - corner[:, 0], corner[:, i + 1] - corner[:, 0])
            for i in range(1, n - 1)
        ]
        np.testing.assert_allclose(np.sum(fan, axis=(0, 1)) / 2, area, atol=1e-9)
        middle = (corner + np.roll(corner, -1, axis=1)) / 2
        np.testing.assert_allclose(wedges.points[face[:, n:]], middle, atol=1e-12)
    place = group_masks(wedges.points)
    for name, mask in place.items():
        assert np.array_equal(wedges.nodes[name], np.flatnonzero(mask)), name


def test_a_single_grain_is_swept_too() -> None:
    mesh = generate(PrismGeometry(), 3.0, "wedge15")
    assert mesh.n_grains == 1
    assert jacobians(mesh.points, mesh.cells)[:, 6].sum() == pytest.approx(24 * DEPTH)


def test_a_boundary_that_meets_an_end_face_is_refused() -> None:
    steep = PrismGeometry(boundary_point=(0, 0.8, 0), boundary_normal=(0.6, 1, 0.3))
    with pytest.raises(ValueError, match="meets an end face"):
        generate(steep, 2.0, "wedge15")


def test_a_shift_of_the_boundary_keeps_the_cells_straight(wedges: PrismMesh) -> None:
    shifted = moved(wedges, 0.3 * boundary_shift(wedges, TILTED))
    middle = shifted.points[shifted.cells[:, EDGES[15]]].mean(axis=2)
    np.testing.assert_allclose(shifted.points[shifted.cells[:, 6:]], middle, atol=1e-12)
    gained = jacobians(shifted.points, shifted.cells)[shifted.grain == 0, 6].sum()
    gained -= jacobians(wedges.points, wedges.cells)[wedges.grain == 0, 6].sum()
    assert gained == pytest.approx(0.3 * 2 * DEPTH)


def test_what_knows_tetrahedra_only_refuses_wedges(wedges: PrismMesh) -> None:
    with pytest.raises(ValueError, match="outer faces are found for tet10 cells only"):
        outer_faces(wedges.cells)


def test_a_round_trip_through_med_changes_nothing(wedges: PrismMesh, tmp_path: Path) -> None:
    write_med(wedges, tmp_path / "prism.med")
    read = read_med(tmp_path / "prism.med")
    for name in ("points", "cells", "grain"):
        np.testing.assert_array_equal(getattr(read, name), getattr(wedges, name))
    for name, faces in wedges.faces.items():
        np.testing.assert_array_equal(read.faces[name], faces)
    for name, nodes in wedges.nodes.items():
        np.testing.assert_array_equal(read.nodes[name], nodes)


def test_med_wedges_have_the_order_and_handedness_of_medcoupling(
    wedges: PrismMesh, tmp_path: Path
) -> None:
    """Signed volumes as those of tetrahedra in MED, and each mid-edge node between its corners."""
    write_med(wedges, tmp_path / "prism.med")
    cells = mc.MEDFileUMesh(str(tmp_path / "prism.med")).getMeshAtLevel(0)
    assert cells.getMeasureField(False).getArray().toNumPyArray().min() > 0
    points = cells.getCoords().toNumPyArray()
    faces = cells.buildDescendingConnectivity()[0]
    for face in range(faces.getNumberOfCells()):
        corners, middle = np.split(np.array(faces.getNodeIdsOfCell(face)), 2)
        between = (points[corners] + points[np.roll(corners, -1)]) / 2
        np.testing.assert_allclose(points[middle], between, atol=1e-12)


def test_wedges_of_the_other_handedness_are_turned_on_reading(
    wedges: PrismMesh, tmp_path: Path
) -> None:
    mirrored = replace(wedges, cells=wedges.cells[:, MIRRORED])
    assert len(inverted_cells(mirrored.points, mirrored.cells)) == len(wedges.cells)
    write_med(mirrored, tmp_path / "prism.med")
    read = read_med(tmp_path / "prism.med")
    assert len(inverted_cells(read.points, read.cells)) == 0
    np.testing.assert_array_equal(read.cells, wedges.cells)


def test_folded_wedges_are_refused(wedges: PrismMesh, tmp_path: Path) -> None:
    points = wedges.points.copy()
    points[wedges.cells[0, 12]] += 50.0
    write_med(replace(wedges, points=points), tmp_path / "prism.med")
    with pytest.raises(ValueError, match=r"\d+ of \d+ cells have a Jacobian ≤ 0"):
        read_med(tmp_path / "prism.med")


def test_vtu_holds_quadratic_wedges_and_their_grains(wedges: PrismMesh, tmp_path: Path) -> None:
    path = tmp_path / "prism.vtu"
    write_vtu(wedges, path)
    read = meshio.read(path)
    np.testing.assert_array_equal(read.cells_dict["wedge15"], wedges.cells)
    np.testing.assert_array_equal(read.cell_data["grain"][0], wedges.grain + 1)
