from __future__ import annotations

from typing import get_args

import numpy as np
import pytest

from driver.virtual.microscope.face_motion import Face, NodalMotion
from meshes.arrays import FloatArray
from meshes.grain_boundary import GrainBoundary
from meshes.prism import CellKind, PrismGeometry, generate
from meshes.surface import trace


@pytest.fixture(scope="module", params=get_args(CellKind))
def face(request: pytest.FixtureRequest) -> Face:
    return Face(trace(generate(PrismGeometry(4.0, 2.0, 1.7), 0.8, request.param)))


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


def test_slopes_on_cells_that_lean_are_difference_quotients() -> None:
    """Trapezia of quad8, whose map is not linear."""
    leaning = PrismGeometry(4.0, 2.0, 1.7, (GrainBoundary((0.0, 2.0, 0.0), (0.4, 1.0, 0.2)),))
    face = Face(trace(generate(leaning, 0.8, "hex20")))
    nodal = np.random.default_rng(2).normal(size=(len(face.mesh.points), 3))
    motion = NodalMotion(face, nodal)
    x, y = np.random.default_rng(3).uniform((-0.99, 0.01), (0.99, 3.99), (200, 2)).T
    step = 1e-6
    slopes = motion(x, y)[1]
    cell = face.locate(x, y)[0]
    for axis, (dx, dy) in enumerate(((step, 0.0), (0.0, step))):
        high, low = motion(x + dx, y + dy)[0], motion(x - dx, y - dy)[0]
        # A kink between cells is no matter of the slope in one of them.
        same = face.locate(x + dx, y + dy)[0] == cell
        same &= face.locate(x - dx, y - dy)[0] == cell
        assert same.mean() > 0.99
        quotient = (high - low) / (2 * step)
        np.testing.assert_allclose(slopes[same, :, axis], quotient[same], atol=1e-7)
