"""Grains on the measured face, and the lines between them."""

from __future__ import annotations

import numpy as np
import pytest

from meshes.grain_boundary import GrainBoundary
from meshes.prism import CellKind, PrismGeometry, generate
from meshes.surface_grains import grains_at, middles_of_grains, segments_between_grains

PLANES = (
    GrainBoundary((0.0, 3.0, 0.0), (0.2, 1.0, 0.3)),
    GrainBoundary((0.0, 7.0, 0.0), (-0.1, 1.0, 0.0)),
)


@pytest.mark.parametrize("kind", ["tet10", "hex20"])
def test_planes_between_grains_are_a_straight_line_each(kind: CellKind) -> None:
    mesh = generate(PrismGeometry(10.0, 4.0, 3.0, PLANES, 4.0), 2.0, kind)
    lines = segments_between_grains(mesh)
    ends = np.array(sorted(sorted(line.tolist()) for line in lines))
    ends = ends[np.argsort(ends[:, :, 1].mean(axis=1))]
    assert len(ends) == 2
    expected = [[[-2.0, 3.4], [2.0, 2.6]], [[-2.0, 6.8], [2.0, 7.2]]]
    np.testing.assert_allclose(ends, expected, atol=1e-9)


@pytest.mark.parametrize("kind", ["tet10", "hex20"])
def test_the_grain_at_a_place_is_that_of_the_planes_and_beside_the_face_of_its_rim(
    kind: CellKind,
) -> None:
    geometry = PrismGeometry(10.0, 4.0, 3.0, PLANES, 4.0)
    mesh = generate(geometry, 2.0, kind)
    x, y = np.meshgrid(np.linspace(-3, 3, 31), np.linspace(-1.013, 11, 60), indexing="ij")
    xy = np.column_stack([x.ravel(), y.ravel()])
    on_rim = np.clip(xy, [-2.0, 0.0], [2.0, 10.0])
    expected = geometry.grain_at(np.column_stack([on_rim, np.zeros(len(xy))]))
    np.testing.assert_array_equal(grains_at(mesh, xy), expected)
    for grain, place in middles_of_grains(mesh):
        assert grains_at(mesh, place[None]).tolist() == [grain]
