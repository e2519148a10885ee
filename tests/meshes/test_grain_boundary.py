"""Several grains in a row: volumes and places of the grains, motions of one boundary, refusals."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from meshes.arrays import FloatArray
from meshes.cells import inverted_cells, outer_faces
from meshes.grain_boundary import GrainBoundary, Vector
from meshes.prism import CellKind, PrismGeometry, generate
from meshes.prism_mesh import PrismMesh
from meshes.velocity import boundary_bow, boundary_shift, boundary_tilt, moved

KINDS: tuple[CellKind, ...] = ("tet10", "hex20")
NORMALS: tuple[Vector, ...] = ((0.15, 1.0, 0.3), (-0.1, 1.0, 0.2), (0.0, 1.0, -0.2))
PLANES = tuple(map(GrainBoundary, ((0.0, 3.0, 0.0), (0.0, 5.4, 0.0), (0.0, 8.0, 0.0)), NORMALS))
LENGTH, WIDTH, DEPTH = 12.0, 4.0, 3.0


def bar(bottom: float = 3.0, boundaries: tuple[GrainBoundary, ...] = PLANES) -> PrismGeometry:
    return PrismGeometry(LENGTH, WIDTH, DEPTH, boundaries, bottom)


def grain_volumes(mesh: PrismMesh) -> FloatArray:
    """Volumes by the divergence theorem over the faces of each grain, cells with plane faces."""
    volumes = []
    for grain in range(mesh.n_grains):
        faces, _ = outer_faces(mesh.cells[mesh.grain == grain])
        corners = mesh.points[faces[:, : faces.shape[1] // 2]]
        first = corners[:, 0]
        volumes.append(
            sum(
                np.einsum("ij,ij->i", first, np.cross(corners[:, k], corners[:, k + 1])).sum() / 6
                for k in range(1, corners.shape[1] - 1)
            )
        )
    return np.array(volumes)


def shared_nodes(mesh: PrismMesh, grain: int) -> FloatArray:
    here, there = (mesh.cells[mesh.grain == g] for g in (grain, grain + 1))
    shared: FloatArray = mesh.points[np.intersect1d(here, there)]
    return shared


def centroid_heights(geometry: PrismGeometry) -> FloatArray:
    """The mean height of a plane over the section is its height at the centroid."""
    below = -DEPTH / 3 * (WIDTH + 2 * geometry.bottom) / (WIDTH + geometry.bottom)
    at = [(b.point, b.normal) for b in geometry.boundaries]
    return np.asarray([p[1] - n[2] / n[1] * (below - p[2]) for p, n in at], dtype=np.float64)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("bottom", [0.0, 3.0])
def test_each_of_four_grains_fills_its_part_of_the_specimen(kind: CellKind, bottom: float) -> None:
    geometry = bar(bottom)
    mesh = generate(geometry, 1.3, kind)
    assert not len(inverted_cells(mesh.points, mesh.cells))
    ends = np.array([0.0, *centroid_heights(geometry), LENGTH])
    area = (WIDTH + bottom) / 2 * DEPTH
    assert grain_volumes(mesh) == pytest.approx(area * np.diff(ends), rel=1e-9)
    for grain, plane in enumerate(PLANES):
        normal = np.array(plane.normal)
        off = (shared_nodes(mesh, grain) - plane.point) @ normal
        assert np.abs(off).max() < 1e-9
    for grain in (0, 1):
        here, there = (mesh.cells[mesh.grain == g] for g in (grain, grain + 2))
        assert not np.intersect1d(here, there).size


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("count", [1, 3])
def test_normals_against_the_loading_axis_count_the_grains_from_its_end(
    kind: CellKind, count: int
) -> None:
    turned = tuple(
        GrainBoundary(plane.point, tuple(-n for n in plane.normal))  # type: ignore[arg-type]
        for plane in PLANES[:count][::-1]
    )
    there = generate(bar(boundaries=PLANES[:count]), 1.5, kind)
    back = generate(bar(boundaries=turned), 1.5, kind)
    assert grain_volumes(back) == pytest.approx(grain_volumes(there)[::-1], rel=1e-9)


def test_the_layers_of_hexahedra_are_equal_in_each_grain() -> None:
    mesh = generate(bar(), 2.0, "hex20", layers=(2, 1, 3, 4))
    assert np.bincount(mesh.grain).tolist() == [4, 2, 6, 8]  # a row of two, as deep as half
    corner = (abs(mesh.points[:, 0] + 2) < 1e-9) & (mesh.points[:, 2] == 0)
    heights = [0.0, *(p.point[1] + 2 * p.normal[0] for p in PLANES), LENGTH]
    parts = [
        np.linspace(a, b, 2 * n + 1)[1:]
        for (a, b), n in zip(pairwise(heights), (2, 1, 3, 4), strict=True)
    ]
    expected = np.concatenate([[0.0], *parts])
    np.testing.assert_allclose(np.sort(mesh.points[corner, 1]), expected, atol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_a_motion_of_one_boundary_leaves_the_others_where_they_are(kind: CellKind) -> None:
    geometry = bar()
    mesh = generate(geometry, 1.5, kind)
    after = moved(mesh, 0.2 * boundary_shift(mesh, geometry, 2))
    area = (WIDTH + 3.0) / 2 * DEPTH
    gained = grain_volumes(after) - grain_volumes(mesh)
    assert gained == pytest.approx([0, 0.2 * area, -0.2 * area, 0], abs=1e-9)
    for field in (
        boundary_tilt(mesh, geometry, "x", 2),
        boundary_tilt(mesh, geometry, "z", 2),
        boundary_bow(mesh, geometry, 2),
    ):
        for other in (mesh.grain == 0, mesh.grain == 3):
            assert np.abs(field[mesh.cells[other]]).max() < 1e-12
        assert np.abs(field[mesh.cells[mesh.grain == 1], 1]).max() > 0.1


@pytest.mark.parametrize("kind", KINDS)
def test_a_tilt_of_one_boundary_turns_its_plane(kind: CellKind) -> None:
    geometry = bar()
    mesh = generate(geometry, 1.5, kind)
    after = moved(mesh, 0.1 * boundary_tilt(mesh, geometry, "x", 3))
    plane = PLANES[2]
    off = (shared_nodes(after, 2) - plane.point) @ (np.array(plane.normal) - (0.1, 0, 0))
    assert np.abs(off).max() < 1e-9


@pytest.mark.parametrize(
    ("number", "plane", "message"),
    [
        (1, ((0, 8.1, 0), (0.5, 1, 0)), r"boundary 3: found .* crosses or touches boundary 2"),
        (1, ((0, 10, 0), (0, 1, 0)), r"boundary 3: found .* on the side of grain 2 of boundary 2"),
        (1, ((0, 5.4, 0), (0, -1, 0)), r"boundary 2: found the normal \(0, -1, 0\), against"),
        (2, ((0, 11.9, 0), (0.1, 1, 0)), r"boundary 3: found .* meets an end face, expected one"),
        (0, ((0, 3, 0), (1, 0, 0)), "boundary 1: found .* meets an end face"),
    ],
)
def test_boundaries_that_do_not_part_a_row_of_grains_are_refused(
    number: int, plane: tuple[Vector, Vector], message: str
) -> None:
    changed = list(PLANES)
    changed[number] = GrainBoundary(*plane)
    with pytest.raises(ValueError, match=message):
        replace(bar(), boundaries=tuple(changed))


def test_a_boundary_that_a_specimen_does_not_have_cannot_be_moved() -> None:
    mesh = generate(bar(), 2.0, "hex20")
    with pytest.raises(ValueError, match="there is no grain boundary 4: the prism has 3 of them"):
        boundary_shift(mesh, bar(), 4)
