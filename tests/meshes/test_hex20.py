"""Meshes of twenty-node hexahedra: shape functions, volumes, conformity, groups, refusals."""

from dataclasses import replace
from pathlib import Path

import medcoupling as mc
import meshio
import numpy as np
import pytest
from numpy.typing import NDArray

from meshes.cells import EDGES, inverted_cells, jacobians, outer_faces
from meshes.files import read_med, write_med, write_vtu
from meshes.grain_boundary import GrainBoundary, Vector
from meshes.hex20 import CHECKED, FACES, MIRRORED, shape_functions
from meshes.prism import LAYER, PrismGeometry, generate
from meshes.prism_mesh import FACE_GROUPS, PrismMesh
from meshes.velocity import boundary_shift, moved
from tests.meshes import raw_med
from tests.meshes.places import DEPTH, group_masks

CELL = np.arange(20)[None]
TILTED = PrismGeometry(boundaries=(GrainBoundary((0, 5.4, 0), (0.15, 1, 0.30)),))
SIZE = 1.0
# Of a side of 4 µm; the boundary crosses the centre line at 5.4 + 0.30 DEPTH / 3 = 5.75 µm.
DIVISIONS, LAYERS = 2, (10, 10)


@pytest.fixture(scope="module")
def bricks() -> PrismMesh:
    return generate(TILTED, SIZE, "hex20")


def reference() -> NDArray[np.float64]:
    square = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
    corners = np.array([[*place, z] for z in (-1, 1) for place in square])
    return np.concatenate([corners, corners[EDGES[20]].mean(axis=1)])


def volumes(mesh: PrismMesh) -> NDArray[np.float64]:
    """Volume of each straight cell [µm³]: two points of Gauss along each axis are exact."""
    spots = reference()[:8] / np.sqrt(3)
    _, gradients = shape_functions(spots)
    maps = np.einsum("cai,qaj->cqij", mesh.points[mesh.cells], gradients)
    result: NDArray[np.float64] = np.linalg.det(maps).sum(axis=1)
    return result


def test_the_shape_functions_hold_every_polynomial_of_the_serendipity_family() -> None:
    """ξᵃ ηᵇ ζᶜ with at most one exponent of two: all quadratic polynomials are among them."""
    spots = np.random.default_rng(4).uniform(-1, 1, (40, 3))
    values, gradients = shape_functions(spots)
    powers = [p for p in np.ndindex(3, 3, 3) if sum(e == 2 for e in p) <= 1]
    assert len(powers) == 20
    for power in powers:
        nodal = np.prod(reference() ** power, axis=1)
        np.testing.assert_allclose(values @ nodal, np.prod(spots**power, axis=1), atol=1e-14)
        for axis in range(3):
            less = np.array(power) - np.eye(3, dtype=int)[axis]
            slope = power[axis] * np.prod(spots ** np.maximum(less, 0), axis=1)
            np.testing.assert_allclose(gradients[:, :, axis] @ nodal, slope, atol=1e-14)


def test_the_gradients_are_those_of_a_complex_step() -> None:
    spots = np.random.default_rng(5).uniform(-1, 1, (40, 3))
    _, gradients = shape_functions(spots)
    for axis, unit in enumerate(np.eye(3)):
        slope = shape_functions(spots + 1e-30j * unit)[0].imag / 1e-30
        np.testing.assert_allclose(gradients[:, :, axis], slope, atol=1e-15)


def test_the_corners_and_the_centre_are_checked() -> None:
    np.testing.assert_array_equal(CHECKED, [*reference()[:8], [0, 0, 0]])


def test_jacobians_of_a_quadratic_map_are_exact() -> None:
    # x = r + 0.1 r² + 0.2 s t, y = 2 s + 0.1 r t, z = t: in the span of the shape functions.
    r, s, t = reference().T
    points = np.column_stack([r + 0.1 * r**2 + 0.2 * s * t, 2 * s + 0.1 * r * t, t])
    r, s, t = np.array([*reference()[:8], [0, 0, 0]]).T
    expected = (1 + 0.2 * r) * 2 - 0.2 * t * 0.1 * t
    assert jacobians(points, CELL)[0] == pytest.approx(expected, rel=1e-14)


def test_a_hexahedron_of_the_other_handedness_is_noticed() -> None:
    other = [[0, 3, 2, 1, 4, 7, 6, 5, 11, 10, 9, 8, 15, 14, 13, 12, 16, 19, 18, 17]]
    assert len(inverted_cells(reference(), CELL)) == 0
    assert inverted_cells(reference(), np.array(other)).tolist() == [0]
    mirrored = reference() * [1, -1, 1]
    assert len(inverted_cells(mirrored, MIRRORED[CELL])) == 0


def test_the_faces_of_one_cell_point_outwards_and_carry_their_mid_edge_nodes() -> None:
    faces, owner = outer_faces(CELL)
    assert {frozenset(face) for face in faces.tolist()} == {frozenset(f) for f in FACES.tolist()}
    assert owner.tolist() == [0] * 6
    corners = reference()[faces[:, :4]]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 3] - corners[:, 0])
    np.testing.assert_allclose(normal, 4 * corners.mean(axis=1))
    midpoints = (corners + np.roll(corners, -1, axis=1)) / 2
    np.testing.assert_allclose(reference()[faces[:, 4:]], midpoints)


def test_the_cells_of_each_grain_fill_its_part_of_the_prism(bricks: PrismMesh) -> None:
    # The mean height of a plane over the section is its height at the centroid Z = −depth/3.
    volume = np.bincount(bricks.grain, volumes(bricks))
    first = 2 * DEPTH * (5.4 + 0.30 * DEPTH / 3)
    np.testing.assert_allclose(volume, [first, 24 * DEPTH - first], rtol=1e-12)
    assert jacobians(bricks.points, bricks.cells).min() > 0
    middle = bricks.points[bricks.cells[:, EDGES[20]]].mean(axis=2)
    np.testing.assert_allclose(bricks.points[bricks.cells[:, 8:]], middle, atol=1e-12)


def test_cells_meet_at_whole_faces_and_the_grains_at_the_boundary(bricks: PrismMesh) -> None:
    assert len(np.unique(bricks.points.round(9), axis=0)) == len(bricks.points)
    assert np.array_equal(np.unique(bricks.cells), np.arange(len(bricks.points)))
    shared = np.intersect1d(bricks.cells[bricks.grain == 0], bricks.cells[bricks.grain == 1])
    assert abs(TILTED.boundaries[0].distance(bricks.points[shared])).max() < 1e-12
    # Of 3 m² quadrilaterals: 3 m² + 3 m + 1 corners and 6 m² + 3 m sides of a section.
    m, layers = DIVISIONS, sum(LAYERS)
    corners, sides = 3 * m**2 + 3 * m + 1, 6 * m**2 + 3 * m
    assert len(shared) == corners + sides
    assert len(bricks.cells) == 3 * m**2 * layers
    assert len(bricks.points) == (corners + sides) * (layers + 1) + corners * layers
    # Outside are both ends and 2 m quadrilaterals a layer on each side.
    outer, _ = outer_faces(bricks.cells)
    assert len(outer) == 2 * 3 * m**2 + 3 * 2 * m * layers


def test_the_layers_follow_from_the_size_and_are_equal_in_each_grain(bricks: PrismMesh) -> None:
    middle = 5.4 + 0.30 * DEPTH / 3
    assert LAYERS == (round(middle / (LAYER * SIZE)), round((12 - middle) / (LAYER * SIZE)))
    per_layer = 3 * DIVISIONS**2
    assert np.bincount(bricks.grain).tolist() == [n * per_layer for n in LAYERS]
    assert len(bricks.faces["TOP"]) == 2 * DIVISIONS * sum(LAYERS)
    centroid = np.flatnonzero(
        (abs(bricks.points[:, 0]) < 1e-9) & (abs(bricks.points[:, 2] + DEPTH / 3) < 1e-9)
    )
    # Corners and the middles between them, along the centre line.
    heights = np.sort(bricks.points[centroid, 1])
    expected = [np.linspace(0, middle, 21), np.linspace(middle, 12, 21)[1:]]
    np.testing.assert_allclose(heights, np.concatenate(expected), atol=1e-12)


@pytest.mark.parametrize(("size", "divisions"), [(4.1, 1), (1.5, 1), (1.0, 2), (0.7, 3), (0.3, 7)])
def test_the_face_has_two_blocks_of_cells_across(size: float, divisions: int) -> None:
    mesh = generate(TILTED, size, "hex20", layers=(1, 1))
    ends = mesh.points[mesh.nodes["L_PLUS"], 0]
    np.testing.assert_allclose(np.sort(ends), np.linspace(-2, 2, 4 * divisions + 1), atol=1e-12)
    assert len(mesh.cells) == 6 * divisions**2


def test_the_longest_side_of_the_section_tells_the_number_of_cells() -> None:
    deep = PrismGeometry(width=2.0, depth=6.0)  # sides of 2 µm and √37 = 6.08 µm
    mesh = generate(deep, 1.0, "hex20", layers=(1,))
    assert len(mesh.cells) == 3 * 3**2


def test_the_numbers_of_layers_can_be_given() -> None:
    mesh = generate(TILTED, 2.0, "hex20", layers=(2, 5))
    assert np.bincount(mesh.grain).tolist() == [6, 15]
    corner = (abs(mesh.points[:, 0] + 2) < 1e-9) & (mesh.points[:, 2] == 0)
    height = 5.4 + 0.15 * 2  # of the boundary at X = −2, Z = 0
    expected = [np.linspace(0, height, 5), np.linspace(height, 12, 11)[1:]]
    heights = np.sort(mesh.points[corner, 1])
    np.testing.assert_allclose(heights, np.concatenate(expected), atol=1e-12)


@pytest.mark.parametrize(
    ("geometry", "kind", "layers", "message"),
    [
        (TILTED, "tet10", (2, 2), r"layers are \(2, 2\) for a mesh of tet10; hex20 alone"),
        (TILTED, "hex20", (0, 2), r"layers are \(0, 2\) in a prism of 2 grains; \(1, 1\) or more"),
        (TILTED, "hex20", (2, 0), r"layers are \(2, 0\) in a prism of 2 grains; \(1, 1\) or more"),
        (PrismGeometry(), "hex20", (2, 2), r"\(2, 2\) in a prism of one grain; \(1,\) or more"),
        (PrismGeometry(), "hex20", (0,), r"\(0,\) in a prism of one grain; \(1,\) or more"),
    ],
)
def test_numbers_of_layers_that_no_mesh_has_are_refused(
    geometry: PrismGeometry, kind: str, layers: tuple[int, ...], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        generate(geometry, 2.0, kind, layers)  # type: ignore[arg-type]


def test_the_same_input_gives_the_same_arrays(bricks: PrismMesh) -> None:
    again = generate(TILTED, SIZE, "hex20")
    for name in ("points", "cells", "grain"):
        np.testing.assert_array_equal(getattr(again, name), getattr(bricks, name))
    for group in ("faces", "nodes"):
        ours, theirs = getattr(bricks, group), getattr(again, group)
        assert ours.keys() == theirs.keys()
        for name, members in ours.items():
            np.testing.assert_array_equal(theirs[name], members)


def test_faces_point_outwards_and_groups_hold_the_nodes_of_their_place(bricks: PrismMesh) -> None:
    expected = {"S_PLUS": (0, 2 * DEPTH, 0), "S_MINUS": (0, -2 * DEPTH, 0), "TOP": (0, 0, 48)}
    assert set(bricks.faces) == set(FACE_GROUPS)
    hull = {tuple(face) for face in outer_faces(bricks.cells)[0].tolist()}
    for name, area in expected.items():
        face = bricks.faces[name]
        assert {tuple(nodes) for nodes in face.tolist()} <= hull
        corner = bricks.points[face[:, :4]]
        normals = np.cross(corner[:, 2] - corner[:, 0], corner[:, 3] - corner[:, 1]) / 2
        assert (normals @ np.array(area) > 0).all()
        np.testing.assert_allclose(normals.sum(axis=0), area, atol=1e-9)
        middle = (corner + np.roll(corner, -1, axis=1)) / 2
        np.testing.assert_allclose(bricks.points[face[:, 4:]], middle, atol=1e-12)
    place = group_masks(bricks.points)
    assert set(bricks.nodes) == set(place)
    for name, mask in place.items():
        assert np.array_equal(bricks.nodes[name], np.flatnonzero(mask)), name


def test_a_single_grain_is_swept_too() -> None:
    mesh = generate(PrismGeometry(), 3.0, "hex20")
    assert mesh.n_grains == 1
    # One cell to a block; 12 / (0.6 · 3) rounds to 7 layers.
    assert len(mesh.cells) == 3 * 7
    assert volumes(mesh).sum() == pytest.approx(24 * DEPTH)


def test_a_boundary_that_meets_an_end_face_is_refused() -> None:
    steep = PrismGeometry(boundaries=(GrainBoundary((0, 0.8, 0), (0.6, 1, 0.3)),))
    with pytest.raises(ValueError, match="meets an end face"):
        generate(steep, 2.0, "hex20")


def test_only_a_boundary_from_side_to_side_takes_layers() -> None:
    def takes(point: Vector, normal: Vector) -> bool:
        return PrismGeometry(boundaries=(GrainBoundary(point, normal),)).crossed_from_side_to_side

    assert PrismGeometry().crossed_from_side_to_side and takes((0.0, 5.4, 0.0), (0.15, 1.0, 0.3))
    assert not takes((0.0, 0.3, 0.0), (0.15, 1.0, 0.3))  # meets an end face
    assert not takes((0.0, 5.4, 0.0), (1.0, 0.0, 0.0))  # along the prism


def test_a_shift_of_the_boundary_keeps_the_cells_straight(bricks: PrismMesh) -> None:
    shifted = moved(bricks, 0.3 * boundary_shift(bricks, TILTED))
    middle = shifted.points[shifted.cells[:, EDGES[20]]].mean(axis=2)
    np.testing.assert_allclose(shifted.points[shifted.cells[:, 8:]], middle, atol=1e-12)
    gained = volumes(shifted)[shifted.grain == 0].sum() - volumes(bricks)[bricks.grain == 0].sum()
    assert gained == pytest.approx(0.3 * 2 * DEPTH)


def test_a_round_trip_through_med_changes_nothing(bricks: PrismMesh, tmp_path: Path) -> None:
    write_med(bricks, tmp_path / "prism.med")
    read = read_med(tmp_path / "prism.med")
    for name in ("points", "cells", "grain"):
        np.testing.assert_array_equal(getattr(read, name), getattr(bricks, name))
    for name, faces in bricks.faces.items():
        np.testing.assert_array_equal(read.faces[name], faces)
    for name, nodes in bricks.nodes.items():
        np.testing.assert_array_equal(read.nodes[name], nodes)


def test_groups_of_nodes_stand_for_the_faces_between_them(
    bricks: PrismMesh, tmp_path: Path
) -> None:
    write_med(replace(bricks, faces={}), tmp_path / "nodes.med")
    read = read_med(tmp_path / "nodes.med")
    for name, faces in bricks.faces.items():
        assert {frozenset(f) for f in read.faces[name]} == {frozenset(f) for f in faces}
        np.testing.assert_array_equal(read.nodes[name], bricks.nodes[name])


def test_the_med_file_holds_the_nodes_in_meds_order_as_h5py_sees_it(
    bricks: PrismMesh, tmp_path: Path
) -> None:
    path = tmp_path / "prism.med"
    write_med(bricks, path)
    np.testing.assert_array_equal(raw_med.coordinates(path, "prism"), bricks.points)
    stored = raw_med.connectivity(path, "prism", "H20")
    np.testing.assert_array_equal(stored, bricks.cells[:, MIRRORED])
    quads = raw_med.connectivity(path, "prism", "QU8")
    for name, faces in bricks.faces.items():
        members = raw_med.members(path, "prism", "QU8", name)
        np.testing.assert_array_equal(quads[members], faces)


def test_med_hexahedra_have_the_order_and_handedness_of_medcoupling(
    bricks: PrismMesh, tmp_path: Path
) -> None:
    """Signed volumes as those of tetrahedra in MED, and each mid-edge node between its corners."""
    write_med(bricks, tmp_path / "prism.med")
    cells = mc.MEDFileUMesh(str(tmp_path / "prism.med")).getMeshAtLevel(0)
    measured = cells.getMeasureField(False).getArray().toNumPyArray()
    assert measured.min() > 0
    np.testing.assert_allclose(measured.sum(), 24 * DEPTH, rtol=1e-12)
    points = cells.getCoords().toNumPyArray()
    faces = cells.buildDescendingConnectivity()[0]
    for face in range(faces.getNumberOfCells()):
        corners, middle = np.split(np.array(faces.getNodeIdsOfCell(face)), 2)
        between = (points[corners] + points[np.roll(corners, -1)]) / 2
        np.testing.assert_allclose(points[middle], between, atol=1e-12)


def test_hexahedra_of_the_other_handedness_are_turned_on_reading(
    bricks: PrismMesh, tmp_path: Path
) -> None:
    mirrored = replace(bricks, cells=bricks.cells[:, MIRRORED])
    assert len(inverted_cells(mirrored.points, mirrored.cells)) == len(bricks.cells)
    write_med(mirrored, tmp_path / "prism.med")
    read = read_med(tmp_path / "prism.med")
    assert len(inverted_cells(read.points, read.cells)) == 0
    np.testing.assert_array_equal(read.cells, bricks.cells)


def test_folded_hexahedra_are_refused(bricks: PrismMesh, tmp_path: Path) -> None:
    points = bricks.points.copy()
    points[bricks.cells[0, 16]] += 50.0
    write_med(replace(bricks, points=points), tmp_path / "prism.med")
    with pytest.raises(ValueError, match=r"\d+ of \d+ cells have a Jacobian ≤ 0"):
        read_med(tmp_path / "prism.med")


def test_vtu_holds_quadratic_hexahedra_and_their_grains(bricks: PrismMesh, tmp_path: Path) -> None:
    path = tmp_path / "prism.vtu"
    write_vtu(bricks, path)
    read = meshio.read(path)
    np.testing.assert_array_equal(read.cells_dict["hexahedron20"], bricks.cells)
    np.testing.assert_array_equal(read.cell_data["grain"][0], bricks.grain + 1)
