"""What both kinds of cells have in common."""

from __future__ import annotations

import numpy as np
import pytest

from meshes import hex20, tet10
from meshes.cells import EDGES, extent_along_y, outer_triangles
from tools.boxes import BOXES

CORNERS = {
    10: np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]),
    20: np.array(
        [[-1.0, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1]]
        + [[-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]]
    ),
}
SHAPES = {10: tet10.shape_functions, 20: hex20.shape_functions}


@pytest.mark.parametrize("n", [10, 20])
def test_each_shape_function_is_one_at_its_own_node_and_null_at_the_others(n: int) -> None:
    corners = CORNERS[n]
    nodes = np.concatenate([corners, corners[EDGES[n]].mean(axis=1)])
    values, _ = SHAPES[n](nodes)
    np.testing.assert_allclose(values, np.eye(n), atol=1e-15)


@pytest.mark.parametrize("n", [10, 20])
def test_shape_gradients_are_difference_quotients_of_the_shape_functions(n: int) -> None:
    spots = np.array([[0.2, 0.3, 0.1], [0.5, 0.1, 0.3], [0.1, 0.1, 0.7]])
    _, gradients = SHAPES[n](spots)
    for axis, step in enumerate(1e-6 * np.eye(3)):
        high, low = SHAPES[n](spots + step)[0], SHAPES[n](spots - step)[0]
        np.testing.assert_allclose(gradients[:, :, axis], (high - low) / 2e-6, atol=1e-9)
    np.testing.assert_allclose(gradients.sum(axis=1), 0.0, atol=1e-15)


@pytest.mark.parametrize("kind", BOXES)
def test_of_a_bar_the_extent_along_y_is_half_of_its_length_whatever_its_cells(kind: str) -> None:
    mesh = BOXES[kind]((2, 3, 2), (2.0, 5.0, 1.0), 0.2)
    np.testing.assert_allclose(extent_along_y(mesh.points + [0, 3.0, 0], mesh.cells), [5.5, 2.5])


@pytest.mark.parametrize("kind", BOXES)
def test_of_a_wedge_the_extent_along_y_is_that_of_its_section(kind: str) -> None:
    """Its height falls to nothing along Y: mean L/3, variance L²/18."""
    mesh = BOXES[kind]((1, 4, 2), (1.0, 3.0, 1.0), 0.0)
    points = mesh.points * np.column_stack(
        [np.ones(len(mesh.points))] * 2 + [1.0 - mesh.points[:, 1] / 3.0]
    )
    np.testing.assert_allclose(
        extent_along_y(points, mesh.cells), [1.0, np.sqrt(3.0 * 9.0 / 18.0)], rtol=1e-3
    )


@pytest.mark.parametrize("kind", BOXES)
def test_the_outer_triangles_cover_the_surface_of_a_box_once(kind: str) -> None:
    mesh = BOXES[kind]()
    size = np.ptp(mesh.points, axis=0)
    corners = mesh.points[outer_triangles(mesh.cells)]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normals, axis=1).sum() / 2
    np.testing.assert_allclose(area, 2 * (size[[0, 1, 2]] * size[[1, 2, 0]]).sum(), rtol=1e-12)
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    on_side = (abs(corners - low) < 1e-9) | (abs(corners - high) < 1e-9)
    assert on_side.all(axis=1).any(axis=1).all()
