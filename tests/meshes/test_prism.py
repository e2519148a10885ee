"""The generated prism: exact volumes and areas, conformity, groups, quality, refusals."""

import math
from concurrent.futures import ThreadPoolExecutor
from itertools import combinations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from meshes.cells import jacobians, outer_faces
from meshes.gmsh_library import load_gmsh
from meshes.grain_boundary import GrainBoundary, Vector
from meshes.prism import CellKind, PrismGeometry, expected_cells, generate
from meshes.prism_mesh import FACE_GROUPS, PrismMesh
from meshes.tet10 import EDGES
from tests.meshes.places import DEPTH, group_masks

PLANES: list[tuple[Vector, Vector]] = [
    ((0, 5.4, 0), (0.15, 1, 0.30)),
    ((0, 6, 0), (0, 1, 0)),
    ((0, 4, 0), (0, -1, 0)),
    ((0, 5, 0), (1, 1, 0.5)),
    ((0, 7, 0), (0.6, 1, -0.9)),
    ((0, 0.8, 0), (0.6, 1, 0.30)),  # cuts the end face S_MINUS
    ((0.3, 6, 0), (1, 0.1, 0)),  # steep: cuts both end faces
    ((0, 0, 0), (1, 0, 0)),  # through the apex line
    ((0, 0, -1), (0, 0, 1)),  # parallel to the measured face
]


def prism_with(plane: tuple[Vector, Vector]) -> PrismGeometry:
    return PrismGeometry(boundaries=(GrainBoundary(plane[0], plane[1]),))


def cell_volumes(mesh: PrismMesh) -> NDArray[np.float64]:
    corners = mesh.points[mesh.cells[:, :4]]
    volumes: NDArray[np.float64] = np.linalg.det(corners[:, 1:] - corners[:, :1]) / 6
    return volumes


def cut_volume(plane: tuple[Vector, Vector]) -> float:
    """Volume of the convex hull of what lies below the plane: corners and cut edges."""
    corners = np.array([[x, y, z] for x, z in ((-2, 0), (2, 0), (0, -DEPTH)) for y in (0.0, 12.0)])
    distance = (corners - np.array(plane[0])) @ np.array(plane[1])
    kept = [corner for corner, d in zip(corners, distance, strict=True) if d <= 0]
    for a, b in combinations(range(6), 2):
        if distance[a] * distance[b] < 0:
            s = distance[a] / (distance[a] - distance[b])
            kept.append(corners[a] + s * (corners[b] - corners[a]))
    return float(ConvexHull(np.array(kept)).volume)


def radius_ratios(mesh: PrismMesh) -> NDArray[np.float64]:
    """Three times the inscribed over the circumscribed radius: 1 for a regular tetrahedron."""
    corners = mesh.points[mesh.cells[:, :4]]
    edges = corners[:, 1:] - corners[:, :1]
    centre = np.linalg.solve(2 * edges, np.sum(edges**2, axis=2)[..., None])[..., 0]
    faces = np.array(list(combinations(range(4), 3)))
    a, b, c = np.moveaxis(corners[:, faces], 2, 0)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=2) / 2
    inscribed = 3 * cell_volumes(mesh) / areas.sum(axis=1)
    ratio: NDArray[np.float64] = 3 * inscribed / np.linalg.norm(centre, axis=1)
    return ratio


@pytest.mark.parametrize("plane", PLANES)
def test_grain_volumes_are_those_of_the_cut_prism(plane: tuple[Vector, Vector]) -> None:
    mesh = generate(prism_with(plane), 2.0)
    volume = np.bincount(mesh.grain, cell_volumes(mesh))
    first = cut_volume(plane)
    assert volume == pytest.approx([first, 12 * 2 * DEPTH - first], rel=1e-9)


def test_the_first_grain_lies_on_the_side_of_the_fixed_end(
    mesh: PrismMesh, geometry: PrismGeometry
) -> None:
    # The mean height of a plane over the section is its height at the centroid Z = −depth/3.
    mean_height = 5.4 + 0.30 * DEPTH / 3
    volume = cell_volumes(mesh)[mesh.grain == 0].sum()
    assert volume == pytest.approx(2 * DEPTH * mean_height, rel=1e-9)
    centres = mesh.points[mesh.cells].mean(axis=1)
    assert (geometry.boundaries[0].distance(centres[mesh.grain == 0]) < 0).all()


@pytest.mark.parametrize("plane", PLANES)
def test_face_areas_are_exact_and_normals_point_outwards(plane: tuple[Vector, Vector]) -> None:
    mesh = generate(prism_with(plane), 2.0)
    expected = {"S_PLUS": (0, 2 * DEPTH, 0), "S_MINUS": (0, -2 * DEPTH, 0), "TOP": (0, 0, 48)}
    for name, area_vector in expected.items():
        corners = mesh.points[mesh.faces[name][:, :3]]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
        assert normals.sum(axis=0) == pytest.approx(area_vector, abs=1e-9)
        assert np.linalg.norm(normals, axis=1).sum() == pytest.approx(max(map(abs, area_vector)))


@pytest.mark.parametrize("plane", PLANES)
def test_the_mesh_conforms(plane: tuple[Vector, Vector]) -> None:
    geometry = prism_with(plane)
    mesh = generate(geometry, 2.0)
    local = np.array([[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]])
    faces = np.sort(mesh.cells[:, local].reshape(-1, 3), axis=1)
    unique, inverse, count = np.unique(faces, axis=0, return_inverse=True, return_counts=True)
    assert set(count) == {1, 2}

    # A face of one cell only lies on the hull of the prism, never inside or on the boundary.
    x, y, z = np.moveaxis(mesh.points[unique[count == 1]], 2, 0)
    side = DEPTH / 2
    on = [np.abs(y), np.abs(y - 12), np.abs(z)]
    on += [np.abs(sign * x * side - z - DEPTH) for sign in (1, -1)]
    assert np.min([distance.max(axis=1) for distance in on], axis=0).max() < 1e-9

    # The grains share the faces of the boundary, all in its plane.
    grains = [set(inverse[np.repeat(mesh.grain, 4) == grain]) for grain in (0, 1)]
    shared = unique[list(grains[0] & grains[1])]
    assert len(shared) > 0
    assert np.abs(geometry.boundaries[0].distance(mesh.points[shared])).max() < 1e-9


@pytest.mark.parametrize("plane", PLANES)
def test_cells_are_straight_in_vtk_order_with_positive_jacobians(
    plane: tuple[Vector, Vector],
) -> None:
    mesh = generate(prism_with(plane), 2.0)
    assert jacobians(mesh.points, mesh.cells).min() > 0
    midpoints = mesh.points[mesh.cells[:, EDGES]].mean(axis=2)
    np.testing.assert_allclose(mesh.points[mesh.cells[:, 4:]], midpoints, atol=1e-12)
    assert len(np.unique(mesh.points.round(9), axis=0)) == len(mesh.points)
    assert np.array_equal(np.unique(mesh.cells), np.arange(len(mesh.points)))


def test_groups_are_complete_and_hold_exactly_the_nodes_of_their_place(mesh: PrismMesh) -> None:
    place = group_masks(mesh.points)
    assert set(mesh.nodes) == {*FACE_GROUPS, "L_PLUS", "L_MINUS", "P_PLUS", "P_MINUS"} == set(place)
    assert set(mesh.faces) == set(FACE_GROUPS)
    for name, mask in place.items():
        assert np.array_equal(mesh.nodes[name], np.flatnonzero(mask)), name
    assert len(mesh.nodes["P_PLUS"]) == len(mesh.nodes["P_MINUS"]) == 1


def test_faces_are_faces_of_cells_mid_edge_nodes_included(mesh: PrismMesh) -> None:
    hull = {tuple(sorted(face)) for face in outer_faces(mesh.cells)[0]}
    for faces in mesh.faces.values():
        assert {tuple(sorted(face)) for face in faces} <= hull
        ends = np.stack([mesh.points[faces[:, :3]], mesh.points[faces[:, [1, 2, 0]]]])
        np.testing.assert_allclose(mesh.points[faces[:, 3:]], ends.mean(axis=0), atol=1e-12)


def test_a_single_grain_fills_the_prism() -> None:
    mesh = generate(PrismGeometry(length=9, width=3, depth=2), 1.5)
    assert mesh.n_grains == 1
    assert cell_volumes(mesh).sum() == pytest.approx(9 * 3 * 2 / 2)


def test_the_same_input_gives_identical_arrays(mesh: PrismMesh, geometry: PrismGeometry) -> None:
    generate(prism_with(PLANES[3]), 1.2)
    again = generate(geometry, 1.65)
    assert np.array_equal(again.points, mesh.points)
    assert np.array_equal(again.cells, mesh.cells)
    assert np.array_equal(again.grain, mesh.grain)
    for name, nodes in mesh.nodes.items():
        assert np.array_equal(again.nodes[name], nodes)
    for name, faces in mesh.faces.items():
        assert np.array_equal(again.faces[name], faces)


def test_meshing_outside_the_main_thread_gives_the_same_mesh(
    mesh: PrismMesh, geometry: PrismGeometry
) -> None:
    with ThreadPoolExecutor(1) as pool:
        again = pool.submit(generate, geometry, 1.65).result()
    assert np.array_equal(again.points, mesh.points)


def test_meshing_is_silent_and_leaves_no_gmsh_session(
    geometry: PrismGeometry, capfd: pytest.CaptureFixture[str]
) -> None:
    generate(geometry, 3.0)
    assert capfd.readouterr() == ("", "")
    assert not load_gmsh().isInitialized()


def test_a_failure_of_gmsh_is_told_and_leaves_no_session(
    geometry: PrismGeometry, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(dimension: int) -> None:
        raise Exception("self-intersecting facets")

    monkeypatch.setattr(load_gmsh().model.mesh, "generate", fail)
    with pytest.raises(RuntimeError, match="could not mesh the prism: self-intersecting facets"):
        generate(geometry, 3.0)
    assert not load_gmsh().isInitialized()


@pytest.mark.parametrize(
    ("size", "fewest", "most"), [(2.0, 150, 220), (1.65, 200, 300), (1.3, 380, 520)]
)
def test_coarse_meshes_have_few_cells_and_no_slivers(
    geometry: PrismGeometry, size: float, fewest: int, most: int
) -> None:
    mesh = generate(geometry, size)
    assert fewest <= len(mesh.cells) <= most
    assert radius_ratios(mesh).min() > 0.3


@pytest.mark.parametrize(
    ("point", "normal", "empty"),
    [
        ((0, 0, 0), (0, 1, 0), 1),
        ((0, 12, 0), (0, 1, 0), 2),
        ((0, 15, 0), (0.15, 1, 0.3), 2),
        ((0, 15, 0), (0.15, -1, 0.3), 1),
        ((2, 0, 0), (1, 0, -1 / math.sqrt(3)), 2),  # the plane of a side face
    ],
)
def test_a_boundary_that_leaves_a_grain_empty_is_refused(
    point: Vector, normal: Vector, empty: int
) -> None:
    with pytest.raises(ValueError, match=f"grain {empty} is empty"):
        generate(PrismGeometry(boundaries=(GrainBoundary(point, normal),)), 2.0)


@pytest.mark.parametrize("size", [0.0, -1.0, math.nan, math.inf])
def test_an_element_size_that_is_not_positive_is_refused(size: float) -> None:
    with pytest.raises(ValueError, match="element size is .* must be positive"):
        generate(PrismGeometry(), size)


def test_a_geometry_that_is_no_prism_is_refused() -> None:
    with pytest.raises(ValueError, match="prism depth is -1 µm; it must be positive"):
        PrismGeometry(depth=-1)
    with pytest.raises(ValueError, match="non-zero normal"):
        GrainBoundary((0, 5, 0), (0, 0, 0))


@pytest.mark.parametrize(("kind", "size"), [("tet10", 0.01), ("hex20", 1e-3), ("tet10", 1e-80)])
def test_a_mesh_beyond_all_machines_is_refused_before_it_is_made(
    kind: CellKind, size: float
) -> None:
    with pytest.raises(ValueError, match="µm would be about .* cells; at most 200000 are expected"):
        generate(PrismGeometry(), size, kind)


@pytest.mark.parametrize(("kind", "size"), [("tet10", 1.1), ("tet10", 0.8), ("hex20", 0.667)])
def test_the_cells_that_are_foretold_are_those_that_come_within_a_third(
    kind: CellKind, size: float
) -> None:
    geometry = PrismGeometry(boundaries=(GrainBoundary((0.0, 5.4, 0.0), (0.15, 1.0, 0.3)),))
    made = len(generate(geometry, size, kind).cells)
    assert expected_cells(geometry, size, kind) == pytest.approx(made, rel=1 / 3)


@pytest.mark.parametrize("sides", [(12.0, 4.0, 1e6), (12.0, 4.0, 0.01), (1200.0, 4.0, 3.4)])
def test_a_prism_as_flat_as_a_foil_or_as_thin_as_a_wire_is_refused(
    sides: tuple[float, float, float],
) -> None:
    with pytest.raises(ValueError, match="µm and its .* µm; a ratio of at most 100 is expected"):
        PrismGeometry(*sides)


@pytest.mark.parametrize("normal", [(0.0, 1e-300, 0.0), (1e300, 1e300, 0.0)])
def test_a_normal_whose_length_is_no_number_is_refused(
    normal: tuple[float, float, float],
) -> None:
    with pytest.raises(ValueError, match="finite numbers and a non-zero normal are expected"):
        PrismGeometry(boundaries=(GrainBoundary((0.0, 5.4, 0.0), normal),))
