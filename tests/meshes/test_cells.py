"""What both kinds of cells have in common."""

from __future__ import annotations

import numpy as np
import pytest

from meshes.cells import outer_triangles
from tests.solver_adapters.boxes import BOXES


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
