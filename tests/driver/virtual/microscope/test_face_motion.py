from __future__ import annotations

import numpy as np
import pytest

from driver.virtual.microscope.face_motion import Face, NodalMotion
from meshes.arrays import FloatArray
from meshes.prism import PrismGeometry, generate
from meshes.surface import trace


@pytest.fixture(scope="module")
def face() -> Face:
    return Face(trace(generate(PrismGeometry(4.0, 2.0, 1.7), 0.8)))


def quadratic(xy: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A motion that quadratic elements hold exactly, with its slopes."""
    x, y = xy.T
    one = np.ones_like(x)
    value = np.column_stack([0.01 * x * y, 0.02 * y**2 - 0.01 * x, 0.03 * x**2 + y])
    slopes = [[0.01 * y, 0.01 * x], [-0.01 * one, 0.04 * y], [0.06 * x, one]]
    return value, np.moveaxis(np.array(slopes), -1, 0)


def test_values_and_slopes_of_a_quadratic_motion_are_exact(face: Face) -> None:
    points = np.random.default_rng(1).uniform((-1, 0), (1, 4), (500, 2))
    found = NodalMotion(face, quadratic(face.mesh.points)[0])(*points.T)
    for value, truth in zip(found, quadratic(points), strict=True):
        np.testing.assert_allclose(value, truth, atol=1e-12)


def test_beyond_an_edge_the_motion_is_that_of_the_edge(face: Face) -> None:
    motion = NodalMotion(face, quadratic(face.mesh.points)[0])
    value, slopes = motion(np.array([0.3, 1.7]), np.array([5.0, 1.2]))
    edge, at_edge = quadratic(np.array([[0.3, 4.0], [1.0, 1.2]]))
    np.testing.assert_allclose(value, edge, atol=1e-7)
    np.testing.assert_allclose(slopes[0, :, 0], at_edge[0, :, 0], atol=1e-7)
    np.testing.assert_allclose(slopes[1, :, 1], at_edge[1, :, 1], atol=1e-7)
    assert not slopes[0, :, 1].any() and not slopes[1, :, 0].any()
