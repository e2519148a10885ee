"""The trace of the measured face, and interpolation on it."""

import numpy as np
import pytest
from numpy.typing import NDArray

from meshes.prism import PrismGeometry, generate
from meshes.prism_mesh import PrismMesh
from meshes.surface import SurfaceMesh, interpolation, interpolation_with_slopes, trace


@pytest.fixture(scope="module")
def surface(mesh: PrismMesh) -> SurfaceMesh:
    return trace(mesh)


def quadratic(xy: NDArray[np.float64]) -> NDArray[np.float64]:
    x, y = xy.T
    result: NDArray[np.float64] = 1.5 - x + 0.3 * y + 0.2 * x**2 - 0.7 * x * y + 0.05 * y**2
    return result


def test_the_trace_holds_the_nodes_and_faces_of_the_top(
    mesh: PrismMesh, surface: SurfaceMesh
) -> None:
    assert np.array_equal(surface.nodes, mesh.nodes["TOP"])
    assert np.array_equal(surface.nodes[surface.cells], mesh.faces["TOP"])
    assert np.array_equal(surface.points, mesh.points[surface.nodes, :2])


def test_a_quadratic_field_is_interpolated_exactly(surface: SurfaceMesh) -> None:
    xy = np.random.default_rng(1).uniform((-2, 0), (2, 12), (5000, 2))
    matrix, inside = interpolation(surface, xy)
    assert inside.all()
    np.testing.assert_allclose(matrix @ quadratic(surface.points), quadratic(xy), atol=1e-12)


def test_the_slopes_of_a_quadratic_field_are_exact(surface: SurfaceMesh) -> None:
    xy = np.random.default_rng(3).uniform((-2, 0), (2, 12), (5000, 2))
    (x, y), nodal = xy.T, quadratic(surface.points)
    value, along_x, along_y = (m @ nodal for m in interpolation_with_slopes(surface, xy))
    np.testing.assert_allclose(value, quadratic(xy), atol=1e-12)
    np.testing.assert_allclose(along_x, -1 + 0.4 * x - 0.7 * y, atol=1e-11)
    np.testing.assert_allclose(along_y, 0.3 - 0.7 * x + 0.1 * y, atol=1e-11)


def test_interpolation_at_the_nodes_is_the_identity(surface: SurfaceMesh) -> None:
    matrix, inside = interpolation(surface, surface.points)
    assert inside.all()
    np.testing.assert_allclose(matrix.toarray(), np.eye(len(surface.points)), atol=1e-12)


def test_points_off_the_face_have_empty_rows(surface: SurfaceMesh) -> None:
    xy = np.random.default_rng(2).uniform((-3, -1), (3, 13), (4000, 2))
    matrix, inside = interpolation(surface, xy)
    on_face = (np.abs(xy[:, 0]) <= 2) & (xy[:, 1] >= 0) & (xy[:, 1] <= 12)
    assert np.array_equal(inside, on_face)
    assert matrix.shape == (4000, len(surface.points))
    np.testing.assert_allclose(matrix.sum(axis=1), on_face, atol=1e-12)
    assert (np.diff(matrix.indptr) == 6 * on_face).all()


def test_the_rim_belongs_to_the_face_within_its_tolerance(surface: SurfaceMesh) -> None:
    rim = np.array([[-2, 0], [2, 12], [0.3, 0], [2, 5.5], [-2 - 1e-11, 3], [1, 12 + 1e-11]])
    off = np.array([[-2 - 1e-6, 3], [1, 12 + 1e-6], [0.3, -1e-6]])
    assert interpolation(surface, rim)[1].all()
    assert not interpolation(surface, off)[1].any()


def test_no_points_give_an_empty_matrix(surface: SurfaceMesh) -> None:
    matrix, inside = interpolation(surface, np.empty((0, 2)))
    assert matrix.shape == (0, len(surface.points))
    assert inside.shape == (0,)


@pytest.fixture(scope="module")
def swept_face(geometry: PrismGeometry) -> SurfaceMesh:
    return trace(generate(geometry, 1.65, "hex20"))


def test_the_face_of_hexahedra_is_a_mesh_of_quad8(swept_face: SurfaceMesh) -> None:
    plane = swept_face.plane
    plane.check()
    assert plane.kind == "quad8"
    # 4 × 12 µm, by the corners of the cells.
    assert plane.size**2 * len(plane.cells) == pytest.approx(48.0)


def test_a_linear_field_is_interpolated_exactly_on_the_face_of_hexahedra(
    swept_face: SurfaceMesh,
) -> None:
    # The cells lean with the boundary: on a parallelogram or trapezium quad8 holds linear fields.
    xy = np.random.default_rng(3).uniform((-1.99, 0.01), (1.99, 11.99), (400, 2))
    matrix, inside = interpolation(swept_face, xy)
    field = np.array([0.3, -0.7])
    assert inside.all()
    assert matrix @ (swept_face.points @ field + 1.5) == pytest.approx(xy @ field + 1.5, abs=1e-10)
    matrix, inside = interpolation(swept_face, np.array([[2.5, 6.0], [0.0, 6.0]]))
    assert inside.tolist() == [False, True] and matrix[[0]].nnz == 0


@pytest.mark.parametrize("face", ["surface", "swept_face"])
def test_slopes_are_those_of_the_interpolation(face: str, request: pytest.FixtureRequest) -> None:
    """In the middle of their cells, by central differences of what is interpolated."""
    mesh: SurfaceMesh = request.getfixturevalue(face)
    corners = 3 if mesh.cells.shape[1] == 6 else 4
    middles = mesh.points[mesh.cells[:, :corners]].mean(axis=1) + [0.013, 0.021]
    nodal, step = np.random.default_rng(4).normal(size=len(mesh.points)), 1e-4
    value, *slopes = (m @ nodal for m in interpolation_with_slopes(mesh, middles))
    np.testing.assert_array_equal(value, interpolation(mesh, middles)[0] @ nodal)
    for axis, slope in zip(np.eye(2), slopes, strict=True):
        ahead, behind = (interpolation(mesh, middles + s * axis)[0] for s in (step, -step))
        np.testing.assert_allclose(slope, (ahead - behind) @ nodal / (2 * step), atol=1e-6)


def test_points_off_the_face_have_no_slopes(surface: SurfaceMesh) -> None:
    off = np.array([[0.0, 6.0], [-3.0, 6.0], [0.0, 13.0]])
    for operator in interpolation_with_slopes(surface, off):
        assert operator.shape == (3, len(surface.points))
        np.testing.assert_array_equal(np.diff(operator.indptr), [6, 0, 0])
