"""Gauss points, and gradients there, of each element."""

from __future__ import annotations

import numpy as np
import pytest

from meshes.grain_boundary import GrainBoundary
from meshes.prism import PrismGeometry, generate
from meshes.prism_mesh import PrismMesh
from solver_adapters.bundled.fem.element import (
    ELEMENTS,
    TET10_FIVE,
    element_of,
    gauss_positions,
    shape_gradient_velocity,
    shape_gradients,
)
from tools.boxes import BOXES, box, hex_box


@pytest.fixture(params=list(BOXES))
def mesh(request: pytest.FixtureRequest) -> PrismMesh:
    return BOXES[request.param]((2, 2, 2), (2.0, 4.0, 3.0), jitter=0.2)


def test_the_gauss_weights_fill_the_volume(mesh: PrismMesh) -> None:
    _, weights = shape_gradients(mesh.points, mesh.cells, element_of(mesh.cells))
    assert weights.shape[1] == len(element_of(mesh.cells).weights)
    np.testing.assert_allclose(weights.sum(), 24.0, rtol=1e-13)


@pytest.mark.parametrize("kind", list(BOXES))
def test_the_gauss_points_integrate_quadratic_fields_exactly(kind: str) -> None:
    """∫ (x y, z²) over 2 × 4 × 3."""
    mesh = BOXES[kind]((2, 2, 2), (2.0, 4.0, 3.0))
    _, weights = shape_gradients(mesh.points, mesh.cells, element_of(mesh.cells))
    x, y, z = gauss_positions(mesh.points, mesh.cells, element_of(mesh.cells)).transpose(2, 0, 1)
    integrals = [np.sum(weights * x * y), np.sum(weights * z**2)]
    np.testing.assert_allclose(integrals, [2.0 * 8.0 * 3.0, 2.0 * 4.0 * 9.0], rtol=1e-13)


def test_five_points_of_a_tetrahedron_integrate_cubic_fields_and_four_do_not() -> None:
    """∫ (x y z, z³) over 2 × 4 × 3."""
    # Of cells without symmetry, whose errors would cancel.
    mesh = box((2, 2, 2), (2.0, 4.0, 3.0), jitter=0.2)
    exact = [2.0 * 8.0 * 4.5, 2.0 * 4.0 * 81.0 / 4.0]
    for points, agree in ((5, True), (4, False), (None, False)):
        element = element_of(mesh.cells, points)
        _, weights = shape_gradients(mesh.points, mesh.cells, element)
        x, y, z = gauss_positions(mesh.points, mesh.cells, element).transpose(2, 0, 1)
        integrals = [np.sum(weights * x * y * z), np.sum(weights * z**3)]
        assert np.allclose(integrals, exact, rtol=1e-12) == agree


def test_a_hexahedron_keeps_its_own_points_whatever_is_asked_of_tetrahedra() -> None:
    assert element_of(BOXES["hex20"]().cells, 5) is ELEMENTS[20]
    assert element_of(box().cells, 5) is TET10_FIVE


@pytest.mark.parametrize("kind", list(BOXES))
def test_a_quadratic_field_has_its_own_gradient_at_the_gauss_points(kind: str) -> None:
    """On straight cells (with parallel faces, of hexahedra) all quadratic polynomials are held."""
    mesh = BOXES[kind]((2, 2, 2), (2.0, 4.0, 3.0))
    x, y, z = mesh.points.T
    gradients, weights = shape_gradients(mesh.points, mesh.cells, element_of(mesh.cells))
    found = np.einsum("eqaj,ea->eqj", gradients, (x * y + 2 * z**2 + 3 * y)[mesh.cells])
    at = gauss_positions(mesh.points, mesh.cells, element_of(mesh.cells))
    expected = np.stack([at[..., 1], at[..., 0] + 3, 4 * at[..., 2]], axis=-1)
    np.testing.assert_allclose(found, expected, atol=1e-12)
    # ∫ (y, x + 3, 4z) over the box
    integral = np.einsum("eq,eqj->j", weights, found)
    np.testing.assert_allclose(integral, 24.0 * np.array([2.0, 1.0 + 3.0, 4 * 1.5]), rtol=1e-13)


def test_a_linear_field_has_its_own_gradient_on_distorted_cells(mesh: PrismMesh) -> None:
    gradients, _ = shape_gradients(mesh.points, mesh.cells, element_of(mesh.cells))
    found = np.einsum("eqaj,ea->eqj", gradients, mesh.points[:, 0][mesh.cells])
    np.testing.assert_allclose(found, np.broadcast_to([1.0, 0, 0], found.shape), atol=1e-13)


def test_the_velocity_of_gradients_and_weights_is_their_difference_quotient(
    mesh: PrismMesh,
) -> None:
    velocity = np.random.default_rng(1).normal(size=mesh.points.shape)
    step = 1e-5
    high, low = (
        shape_gradients(mesh.points + sign * step * velocity, mesh.cells, element_of(mesh.cells))
        for sign in (1, -1)
    )
    gradients, weights = shape_gradients(mesh.points, mesh.cells, element_of(mesh.cells))
    found = shape_gradient_velocity(gradients, weights, mesh.cells, velocity)
    for k in range(2):
        expected = (high[k] - low[k]) / (2 * step)
        np.testing.assert_allclose(found[k], expected, atol=1e-7 * abs(expected).max())


def test_an_inverted_cell_is_refused_by_its_number() -> None:
    mesh = box((2, 2, 2), (2.0, 4.0, 3.0), jitter=0.2)
    cells = mesh.cells.copy()
    cells[5] = cells[5, [1, 0, 2, 3, 4, 6, 5, 8, 7, 9]]
    with pytest.raises(ValueError, match="cell 5 of the mesh is inverted"):
        shape_gradients(mesh.points, cells, element_of(cells))


def test_cells_of_another_kind_are_refused() -> None:
    assert sorted(ELEMENTS) == [10, 20]
    with pytest.raises(ValueError, match=r"15 nodes; expected one of tet10 \(10\), hex20 \(20\)"):
        element_of(np.arange(15)[None])


def _motions_without_strain(mesh: PrismMesh) -> int:
    """Number of independent motions of the nodes that strain no Gauss point."""
    gradients, _ = shape_gradients(mesh.points, mesh.cells, element_of(mesh.cells))
    strains = []
    for cell, of_cell in zip(mesh.cells, gradients, strict=True):
        for of_point in of_cell:
            for i, j in np.argwhere(np.tri(3)):
                row = np.zeros(mesh.points.shape)
                row[cell, i] += of_point[:, j]
                row[cell, j] += of_point[:, i]
                strains.append(row.ravel())
    return mesh.points.size - int(np.linalg.matrix_rank(np.array(strains)))


def test_only_a_body_one_hexahedron_wide_moves_without_strain() -> None:
    """Beside the six rigid motions: six of a lone cell, one at each face of a straight column."""
    shapes = {(1, 1, 1): 6, (1, 2, 1): 1 + 2, (1, 4, 1): 3 + 2, (2, 2, 1): 0, (2, 2, 2): 0}
    for shape, more in shapes.items():
        assert _motions_without_strain(hex_box(shape)) == 6 + more
    tilted = PrismGeometry(boundaries=(GrainBoundary((0, 5.4, 0), (0.15, 1, 0.30)),))
    for geometry, layers in ((PrismGeometry(), (1,)), (tilted, (1, 1))):
        mesh = generate(geometry, 4.0, "hex20", layers)
        assert len(mesh.cells) == 3 * sum(layers)
        assert _motions_without_strain(mesh) == 6
