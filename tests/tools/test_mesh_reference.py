from __future__ import annotations

import numpy as np
import pytest

from meshes.arrays import FloatArray
from meshes.grain_boundary import GrainBoundary
from meshes.prism import CellKind, PrismGeometry, generate
from meshes.surface import trace
from tools.mesh_reference import on_face

GEOMETRY = PrismGeometry(8.0, 4.0, 3.46, (GrainBoundary((0.0, 3.6, 0.0), (0.15, 1.0, 0.3)),))


EDGE = 1e-4  # µm, by which a motion of such slopes is off where the edge is drawn onto the face


def moved(points: FloatArray, curved: float) -> FloatArray:
    """Two images of a motion, shape (2, n, 3)."""
    x, y = points.T
    curvature = curved * np.stack([x * y, x * y - y**2, 3 * x**2], axis=-1)
    first = np.stack([1 + 2 * x, x - y, 3 * x - y], axis=-1) + curvature
    return np.stack([first, 2 * first])


@pytest.mark.parametrize(("kind", "curved"), [("tet10", 1.0), ("hex20", 0.0)])
def test_a_motion_that_the_cells_hold_is_read_exactly_between_the_nodes(
    kind: CellKind, curved: float
) -> None:
    """Eight nodes of a side that is no parallelogram hold what is linear, six what is quadratic."""
    face = trace(generate(GEOMETRY, 1.5, kind))
    points = trace(generate(GEOMETRY, 1.1, "tet10")).points
    read = on_face(face, moved(face.points, curved), points)
    np.testing.assert_allclose(read, moved(points, curved), rtol=0, atol=EDGE)


def test_a_point_beyond_the_face_is_refused() -> None:
    face = trace(generate(GEOMETRY, 1.5))
    with pytest.raises(ValueError, match="found one beyond it, expected all on it"):
        on_face(face, moved(face.points, 1.0), np.array([[0.0, 8.01]]))
