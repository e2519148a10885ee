"""Grains of a label image: their lines on the face, and the columns below them."""

from __future__ import annotations

import numpy as np
import pytest

from meshes.arrays import FloatArray, IntArray
from meshes.cells import jacobians, outer_faces
from meshes.columnar import columns_of, generate_columns
from meshes.label_lines import lines_between, without_specks
from meshes.prism import PrismGeometry
from meshes.surface_grains import segments_between_grains
from meshes.user_mesh import measures_of

WIDTH, LENGTH, PIXEL = 4.0, 12.0, 0.1


def places() -> tuple[FloatArray, FloatArray]:
    """X and Y of the squares of the face."""
    x = (np.arange(round(WIDTH / PIXEL)) + 0.5) * PIXEL - WIDTH / 2
    y = (np.arange(round(LENGTH / PIXEL)) + 0.5) * PIXEL
    xx, yy = np.meshgrid(x, y, indexing="ij")
    return xx, yy


def four_grains() -> IntArray:
    """Four grains that meet in threes, with curved boundaries."""
    x, y = places()
    middle = np.where(x > 0.3 * np.sin(y), 1, 2)
    return np.where(y < 4 + 0.3 * np.sin(2 * x), 0, np.where(y > 8.5 + 0.1 * x**2, 3, middle))


@pytest.mark.parametrize("slope", [0.0, 0.15, -0.4, 1.0])
def test_a_straight_boundary_is_one_straight_line_to_half_a_pixel(slope: float) -> None:
    x, y = places()
    columns = columns_of((y > 6.0 + slope * x).astype(int), WIDTH, LENGTH)
    (line,) = columns.lines
    assert len(line) == 2
    order = np.argsort(line[:, 0])
    np.testing.assert_allclose(line[order, 0], [-2.0, 2.0])
    expected = 6.0 + slope * np.array([-2.0, 2.0])
    np.testing.assert_allclose(line[order, 1], expected, atol=0.5 * PIXEL * (1 + abs(slope)))


def test_lines_of_four_grains_meet_in_threes_and_bound_their_areas() -> None:
    grain = four_grains()
    columns = columns_of(grain, WIDTH, LENGTH)
    ends = np.round([line[k] for line in columns.lines for k in (0, -1)], 9)
    inside = ends[(np.abs(ends[:, 0]) < WIDTH / 2 - 1e-6)]
    _, meeting = np.unique(inside, axis=0, return_counts=True)
    assert len(columns.lines) == 5
    assert meeting.tolist() == [3, 3]


@pytest.mark.parametrize(("depth", "bottom"), [(4.0, 4.0), (3.0, 5.0), (3.4, 0.0)])
def test_columns_conform_and_have_the_volumes_of_their_grains(depth: float, bottom: float) -> None:
    geometry = PrismGeometry(LENGTH, WIDTH, depth, (), bottom)
    columns = columns_of(four_grains(), WIDTH, LENGTH)
    mesh = generate_columns(geometry, columns, 2.0)
    volumes = jacobians(mesh.points, mesh.cells)
    assert volumes.min() > 0
    assert volumes[:, -1].sum() / 6 == pytest.approx(geometry.section.area * LENGTH)
    outer, _ = outer_faces(mesh.cells)
    corners = mesh.points[outer[:, :3]]
    # Each outer face lies on the outside: there is no gap between columns.
    flux = np.sum(corners[:, 0] * np.cross(corners[:, 1], corners[:, 2])) / 6
    assert flux == pytest.approx(geometry.section.area * LENGTH)
    assert measures_of(mesh).area == pytest.approx(geometry.section.area)
    if bottom == WIDTH:
        shares = np.bincount(mesh.grain, weights=volumes[:, -1]) / volumes[:, -1].sum()
        expected = np.bincount(four_grains().ravel()) / four_grains().size
        np.testing.assert_allclose(shares, expected, atol=0.02)
    # The lines of the mesh on the face are those that it was made of.
    found = segments_between_grains(mesh)
    length = sum(np.linalg.norm(np.diff(line, axis=0), axis=1).sum() for line in columns.lines)
    assert np.linalg.norm(found[:, 1] - found[:, 0], axis=1).sum() == pytest.approx(length)


def test_a_grain_inside_another_is_a_column_of_its_own() -> None:
    x, y = places()
    grain = (x**2 + (y - 6.0) ** 2 < 1.0).astype(int)
    columns = columns_of(grain, WIDTH, LENGTH)
    (line,) = columns.lines
    np.testing.assert_array_equal(line[0], line[-1])
    mesh = generate_columns(PrismGeometry(LENGTH, WIDTH, 2.0, (), WIDTH), columns, 2.0)
    volume = jacobians(mesh.points, mesh.cells)[mesh.grain == 1, -1].sum() / 6
    assert volume == pytest.approx(2.0 * np.pi, rel=0.1)


def test_specks_and_pixels_of_no_grain_go_to_the_nearest_grain() -> None:
    grain = four_grains()
    spoiled = grain.copy()
    spoiled[5, 5], spoiled[20, 100] = 3, 1
    spoiled[:, 60] = -1
    assert (without_specks(spoiled, 16.0) != grain).mean() < 0.002
    assert len(columns_of(spoiled, WIDTH, LENGTH).lines) == 5


def test_a_grain_that_is_a_speck_alone_is_refused() -> None:
    grain = np.zeros((40, 120), dtype=np.int64)
    grain[3, 4] = 1
    with pytest.raises(ValueError, match="found no region of grain 2 with 0.16 µm² or more"):
        columns_of(grain, WIDTH, LENGTH)


def test_one_grain_has_no_line() -> None:
    assert lines_between(np.zeros((4, 5), dtype=np.int64), (1.0, 1.0), 0.1) == ()
    columns = columns_of(np.zeros((4, 12), dtype=np.int64), WIDTH, LENGTH)
    mesh = generate_columns(PrismGeometry(LENGTH, WIDTH, 2.0, (), WIDTH), columns, 3.0)
    assert mesh.n_grains == 1


def test_names_of_grains_stand_inside_them() -> None:
    columns = columns_of(four_grains(), WIDTH, LENGTH)
    for grain, place in columns.middles(WIDTH, LENGTH):
        assert columns.at(place[None], WIDTH, LENGTH).tolist() == [grain]
    assert [grain for grain, _ in columns.middles(WIDTH, LENGTH)] == [0, 1, 2, 3]
