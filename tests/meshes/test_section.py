from __future__ import annotations

import numpy as np
import pytest

from meshes.cells import inverted_cells
from meshes.grain_boundary import GrainBoundary
from meshes.prism import CellKind, PrismGeometry, expected_cells, generate
from meshes.section import Section

KINDS: list[CellKind] = ["tet10", "hex20"]


def test_a_triangle_and_a_rectangle_have_their_area_and_centroid() -> None:
    """Centroids d/3 and d/2 below the face."""
    triangle, rectangle = Section(4.0, 3.0), Section(4.0, 3.0, 4.0)
    assert (triangle.area, rectangle.area) == (6.0, 12.0)
    assert (triangle.centroid_depth, rectangle.centroid_depth) == pytest.approx((1.0, 1.5))


def test_a_trapezoid_has_the_moments_of_its_outline() -> None:
    """Integrated over the depth."""
    section = Section(4.0, 3.0, 1.5)
    edges = np.linspace(0.0, 3.0, 20001)
    z = 0.5 * (edges[1:] + edges[:-1])
    weights = 4.0 + (1.5 - 4.0) * z / 3.0
    assert section.area == pytest.approx(3.0 * weights.mean())
    assert section.centroid_depth == pytest.approx(np.average(z, weights=weights))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("bottom", [0.0, 2.0, 3.0, 4.0])
def test_the_section_of_a_mesh_is_that_it_was_made_of(kind: CellKind, bottom: float) -> None:
    mesh = generate(PrismGeometry(5.0, 3.0, 2.0, bottom=bottom), 1.5, kind)
    found = Section.of(mesh.points)
    assert (found.width, found.depth, found.bottom) == pytest.approx((3.0, 2.0, bottom))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("bottom", [2.0, 3.0, 4.0])
def test_cells_of_a_bar_fill_it_grain_by_grain(kind: CellKind, bottom: float) -> None:
    """Volumes by the divergence theorem, of the outer faces alone."""
    geometry = PrismGeometry(
        8.0, 3.0, 2.0, (GrainBoundary((0.0, 3.6, 0.0), (0.15, 1.0, 0.3)),), bottom
    )
    mesh = generate(geometry, 0.9, kind)
    assert not len(inverted_cells(mesh.points, mesh.cells))
    corners = mesh.cells[:, : 4 if kind == "tet10" else 8]
    centres = mesh.points[corners].mean(axis=1)
    assert ((geometry.boundaries[0].distance(centres) > 0) == mesh.grain).all()
    for group, axis, area in (
        ("S_PLUS", 1, (3.0 + bottom) / 2 * 2.0),
        ("S_MINUS", 1, (3.0 + bottom) / 2 * 2.0),
        ("TOP", 2, 24.0),
    ):
        face = mesh.faces[group]
        n = 3 if kind == "tet10" else 4
        outline = np.delete(mesh.points[face[:, :n]], axis, axis=2)
        x, y = outline[..., 0], outline[..., 1]
        areas = 0.5 * np.sum(x * np.roll(y, -1, 1) - y * np.roll(x, -1, 1), axis=1)
        assert abs(areas.sum()) == pytest.approx(area)
        assert np.ptp(mesh.points[face][..., axis]) == 0.0
    made = len(mesh.cells)
    assert expected_cells(geometry, 0.9, kind) == pytest.approx(made, rel=1 / 3)


def test_sections_of_any_divisions_are_of_one_family() -> None:
    for section in (Section(3.0, 2.0, 3.0), Section(2.0, 4.0, 2.0), Section(4.0, 4.0, 3.0)):
        for divisions in (1, 2, 5):
            counts = section.quadrilaterals(divisions)
            assert counts == tuple(divisions * count for count in section.quadrilaterals(1))
            assert section.divisions_of(counts[0] * counts[1]) == divisions
    assert Section(3.0, 2.0, 3.0).quadrilaterals(1) == (2, 1)
    assert Section(2.0, 4.0, 2.0).quadrilaterals(1) == (1, 2)
    assert Section(4.0, 4.0, 3.0).quadrilaterals(1) == (2, 2)


@pytest.mark.parametrize("bottom", [-1.0, float("nan")])
def test_a_far_side_of_no_width_is_refused(bottom: float) -> None:
    with pytest.raises(ValueError, match="prism bottom is .*; it must be 0 or more"):
        PrismGeometry(bottom=bottom)


@pytest.mark.parametrize("bottom", [0.01, 900.0])
def test_a_far_side_out_of_all_proportion_is_refused(bottom: float) -> None:
    with pytest.raises(ValueError, match="bottom .* a ratio of at most 100 is expected"):
        PrismGeometry(bottom=bottom)
