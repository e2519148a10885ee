"""Jacobians of straight and curved tet10 cells, against maps with a known gradient."""

import numpy as np
import pytest

from meshes.cells import inverted_cells, jacobians, outer_faces
from meshes.tet10 import EDGES, MIRRORED, centre_gradients

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)
REFERENCE = np.concatenate([CORNERS, CORNERS[EDGES].mean(axis=1)])
CELL = np.arange(10)[None]


def test_jacobians_of_a_quadratic_map_are_exact() -> None:
    # x = r + 0.3 r² + 0.2 s t, y = 2 s, z = t: the determinant is 2 (1 + 0.6 r).
    r, s, t = REFERENCE.T
    points = np.column_stack([r + 0.3 * r**2 + 0.2 * s * t, 2 * s, t])
    at = np.array([0, 1, 0, 0, 0.25])
    assert jacobians(points, CELL)[0] == pytest.approx(2 * (1 + 0.6 * at), rel=1e-14)


def test_the_mirrored_order_describes_the_same_curved_cell_with_the_other_sign() -> None:
    r, s, t = REFERENCE.T
    points = np.column_stack([r + 0.1 * r * s, s + 0.2 * t**2, t])
    before, after = jacobians(points, CELL)[0], jacobians(points, MIRRORED[CELL])[0]
    assert after == pytest.approx(-before[[0, 2, 1, 3, 4]], rel=1e-14)


def test_a_mid_edge_node_out_of_order_is_noticed() -> None:
    gmsh_order = np.array([[0, 1, 2, 3, 4, 5, 6, 7, 9, 8]])
    assert len(inverted_cells(REFERENCE, CELL)) == 0
    assert len(inverted_cells(REFERENCE, gmsh_order)) == 1


def test_a_cell_with_an_undefined_node_is_refused() -> None:
    points = REFERENCE.copy()
    points[5] = np.nan
    assert inverted_cells(points, CELL).tolist() == [0]


def test_the_faces_of_one_cell_point_outwards_and_carry_their_mid_edge_nodes() -> None:
    faces, owner = outer_faces(CELL)
    assert owner.tolist() == [0] * 4
    corners = REFERENCE[faces[:, :3]]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    outwards = corners.mean(axis=1) - REFERENCE[:4].mean(axis=0)
    assert len(faces) == 4
    assert (np.sum(normal * outwards, axis=1) > 0).all()
    midpoints = (corners + np.roll(corners, -1, axis=1)) / 2
    np.testing.assert_allclose(REFERENCE[faces[:, 3:]], midpoints)


def test_gradients_at_the_centre_are_the_means_of_a_quadratic_field() -> None:
    """f = x² + 3 y z − 2 x over a straight cell: its mean gradient is that at the centroid."""
    points = REFERENCE @ [[2.0, 0.3, 0.1], [0.2, 1.5, -0.1], [-0.3, 0.4, 1.2]] + [1.0, 2.0, 3.0]
    x, y, z = points.T
    found = np.einsum("a,cai->ci", x**2 + 3 * y * z - 2 * x, centre_gradients(points, CELL))
    cx, cy, cz = points[:4].mean(axis=0)
    np.testing.assert_allclose(found[0], [2 * cx - 2, 3 * cz, 3 * cy], rtol=1e-13)
