"""Node velocities of geometric parameters, against prisms generated with the changed geometry."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from meshes.arrays import FloatArray
from meshes.grain_boundary import GrainBoundary
from meshes.prism import PrismGeometry, generate
from meshes.prism_mesh import PrismMesh
from meshes.tet10 import EDGES
from meshes.velocity import (
    InvertedCellsError,
    apex_shift,
    boundary_bow,
    boundary_shift,
    boundary_tilt,
    depth_scale,
    moved,
)

Field = Callable[[PrismMesh, PrismGeometry], FloatArray]

FIELDS: dict[str, Field] = {
    "shift": boundary_shift,
    "tilt x": lambda mesh, geometry: boundary_tilt(mesh, geometry, "x"),
    "tilt z": lambda mesh, geometry: boundary_tilt(mesh, geometry, "z"),
    "bow": boundary_bow,
    "depth": depth_scale,
    "apex": apex_shift,
}


def grain_volumes(mesh: PrismMesh) -> FloatArray:
    corners = mesh.points[mesh.cells[:, :4]]
    volumes: FloatArray = np.linalg.det(corners[:, 1:] - corners[:, :1]) / 6
    return np.array([volumes[mesh.grain == grain].sum() for grain in range(mesh.n_grains)])


def boundary_nodes(mesh: PrismMesh) -> NDArray[np.int64]:
    return np.intersect1d(mesh.cells[mesh.grain == 0], mesh.cells[mesh.grain == 1])


def changed(geometry: PrismGeometry, name: str, step: float) -> PrismGeometry:
    """The geometry after the parameter has changed by `step`, written out from its meaning."""
    (boundary,) = geometry.boundaries
    (x, y, z), (nx, ny, nz) = boundary.point, boundary.normal
    if name == "shift":
        return replace(geometry, boundaries=(GrainBoundary((x, y + step, z), (nx, ny, nz)),))
    if name == "tilt x":
        y += step * x
        return replace(geometry, boundaries=(GrainBoundary((x, y, z), (nx - step * ny, ny, nz)),))
    if name == "tilt z":
        y += step * (z + geometry.depth / 3)
        return replace(geometry, boundaries=(GrainBoundary((x, y, z), (nx, ny, nz - step * ny)),))
    scale = 1 + step
    return replace(
        geometry,
        depth=geometry.depth * scale,
        boundaries=(GrainBoundary((x, y, z * scale), (nx, ny, nz / scale)),),
    )


@pytest.mark.parametrize("name", ["shift", "tilt x", "tilt z", "depth"])
@pytest.mark.parametrize("step", [-0.1, 0.1])
def test_the_moved_mesh_is_a_mesh_of_the_changed_geometry(
    mesh: PrismMesh, geometry: PrismGeometry, name: str, step: float
) -> None:
    target = changed(geometry, name, step)
    after = moved(mesh, step * FIELDS[name](mesh, geometry))
    boundary = after.points[boundary_nodes(mesh)]
    assert np.abs(target.boundaries[0].distance(boundary)).max() < 1e-8
    assert grain_volumes(after) == pytest.approx(grain_volumes(generate(target, 2.0)), rel=1e-8)


@pytest.mark.parametrize("name", FIELDS)
def test_every_field_keeps_the_named_faces_in_their_planes(
    mesh: PrismMesh, geometry: PrismGeometry, name: str
) -> None:
    after = moved(mesh, 0.05 * FIELDS[name](mesh, geometry))
    assert (after.points[mesh.nodes["S_PLUS"], 1] == 12).all()
    assert (after.points[mesh.nodes["S_MINUS"], 1] == 0).all()
    assert (after.points[mesh.nodes["TOP"], 2] == 0).all()


@pytest.mark.parametrize("name", FIELDS)
def test_every_field_keeps_the_sides_plane(
    mesh: PrismMesh, geometry: PrismGeometry, name: str
) -> None:
    after = moved(mesh, 0.05 * FIELDS[name](mesh, geometry))
    for sign in (-1, 1):
        side = np.abs(sign * mesh.points[:, 0] * np.sqrt(3) - mesh.points[:, 2] - geometry.depth)
        nodes = after.points[side < 1e-9]
        assert len(nodes) > 20
        assert np.linalg.svd(nodes - nodes.mean(axis=0), compute_uv=False)[2] < 1e-9


@pytest.mark.parametrize("name", FIELDS)
def test_every_field_keeps_mid_edge_nodes_in_the_middle(
    mesh: PrismMesh, geometry: PrismGeometry, name: str
) -> None:
    velocity = FIELDS[name](mesh, geometry)
    middle = velocity[mesh.cells[:, EDGES]].mean(axis=2)
    np.testing.assert_allclose(velocity[mesh.cells[:, 4:]], middle, atol=1e-12)


def test_the_shift_is_one_on_the_boundary_zero_at_the_ends_and_along_y(
    mesh: PrismMesh, geometry: PrismGeometry
) -> None:
    velocity = boundary_shift(mesh, geometry)
    np.testing.assert_allclose(velocity[boundary_nodes(mesh), 1], 1, atol=1e-8)
    assert not velocity[mesh.nodes["S_PLUS"]].any()
    assert not velocity[mesh.nodes["S_MINUS"]].any()
    assert not velocity[:, [0, 2]].any()
    assert velocity.min() >= 0 and velocity.max() <= 1 + 1e-8


def test_the_bow_displaces_the_corners_of_the_boundary_by_its_parabola(
    mesh: PrismMesh, geometry: PrismGeometry
) -> None:
    corners = np.intersect1d(boundary_nodes(mesh), mesh.cells[:, :4])
    velocity = boundary_bow(mesh, geometry)[corners, 1]
    parabola = 1 - mesh.points[corners, 0] ** 2 / 4
    np.testing.assert_allclose(velocity, parabola, atol=1e-8)
    assert np.ptp(velocity) > 0.9


def test_tilts_about_the_centroid_keep_the_grain_volumes(
    mesh: PrismMesh, geometry: PrismGeometry
) -> None:
    for name in ("tilt x", "tilt z"):
        after = moved(mesh, 0.1 * FIELDS[name](mesh, geometry))
        assert grain_volumes(after) == pytest.approx(grain_volumes(mesh), rel=1e-8)


def test_the_apex_line_moves_alone(mesh: PrismMesh, geometry: PrismGeometry) -> None:
    after = moved(mesh, 0.2 * apex_shift(mesh, geometry))
    for apex in ("P_PLUS", "P_MINUS"):
        assert after.points[mesh.nodes[apex], 0] == pytest.approx(0.2, abs=1e-9)
    top = mesh.nodes["TOP"]
    assert np.array_equal(after.points[top], mesh.points[top])
    assert grain_volumes(after).sum() == pytest.approx(24 * geometry.depth)


def test_a_move_that_inverts_cells_is_refused(mesh: PrismMesh, geometry: PrismGeometry) -> None:
    with pytest.raises(InvertedCellsError, match=r"inverts \d+ of \d+ cells"):
        moved(mesh, 10 * boundary_shift(mesh, geometry))


@pytest.mark.parametrize(
    ("point", "normal"),
    [((0, 0.8, 0), (0.6, 1, 0.3)), ((0.3, 6, 0), (1, 0.1, 0)), ((0, 6, 0), (1, 0, 0))],
)
def test_a_boundary_that_meets_an_end_cannot_be_moved(
    point: tuple[float, float, float], normal: tuple[float, float, float]
) -> None:
    geometry = PrismGeometry(boundaries=(GrainBoundary(point, normal),))
    with pytest.raises(ValueError, match="expected to cross the prism from side to side"):
        boundary_shift(generate(geometry, 2.0), geometry)


def test_a_single_grain_has_no_boundary_to_move() -> None:
    geometry = PrismGeometry()
    with pytest.raises(ValueError, match="there is no grain boundary 1: the prism has 0 of them"):
        boundary_shift(generate(geometry, 3.0), geometry)
