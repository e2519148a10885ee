"""What the maps of free correlation hold."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection, QuadMesh
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from driver.report import measured_maps as maps
from driver.report.maps import Face
from driver.report.measured import MeasuredMotion
from meshes.arrays import FloatArray
from tests.driver.invented_results import ORIGIN, PEAKS, PIXEL


def polygons(axes: Axes) -> list[list[FloatArray]]:
    """Vertices of the elements drawn in each mesh."""
    found = [c for c in axes.collections if isinstance(c, PolyCollection)]
    return [[np.asarray(path.vertices)[:-1] for path in c.get_paths()] for c in found]


def bars(figure: Figure, label: str) -> list[Axes]:
    return [a for a in figure.axes if label in (a.get_xlabel(), a.get_ylabel())]


def test_the_reference_is_in_nanometres_over_micrometres_with_both_meshes(
    measured: MeasuredMotion,
) -> None:
    figure = maps.reference(measured)
    axes = figure.axes[0]
    nm = 1e3 * measured.reference
    region = nm[measured.face.rows, measured.face.cols]
    assert np.asarray(axes.images[0].get_array()) == pytest.approx(nm - np.median(region))
    left, right, bottom, top = axes.images[0].get_extent()
    assert (left, right) == pytest.approx(((-0.5 - ORIGIN[1]) * PIXEL, (119.5 - ORIGIN[1]) * PIXEL))
    assert (bottom, top) == pytest.approx(((40.5 - ORIGIN[0]) * PIXEL, (-0.5 - ORIGIN[0]) * PIXEL))
    fine, coarse = polygons(axes)[:2]
    assert (len(fine), len(coarse)) == (4 * 13, 2 * 6)
    corners = np.concatenate(coarse)
    assert corners.min(axis=0) == pytest.approx(measured.nodes_uv.min(axis=0)[::-1])
    assert corners.max(axis=0) == pytest.approx(measured.nodes_uv.max(axis=0)[::-1])
    assert "mesh of u, v: 12 elements" in [t.get_text() for t in figure.legends[0].get_texts()]


def test_the_scale_bar_is_as_long_as_it_says(measured: MeasuredMotion) -> None:
    axes = maps.reference(measured).axes[0]
    bar = axes.patches[0]
    assert isinstance(bar, Rectangle)
    assert bar.get_width() == 2.0
    assert [text.get_text().strip() for text in axes.texts] == ["2 µm"]


def test_each_component_has_one_colour_scale_for_all_images(measured: MeasuredMotion) -> None:
    figure = maps.fields(measured)
    shown = 1e3 * measured.motion
    bar = bars(figure, "v (along Y), mean removed [nm]")
    assert len(bar) == 1
    assert bar[0].get_xlim() == pytest.approx(np.percentile(shown[..., 1], [1, 99]))
    # The map itself: pixel for pixel the colour of its value on that scale, darkened evenly
    # over red, green and blue.
    low, high = bar[0].get_xlim()
    for row in range(len(PEAKS)):
        mesh = next(c for c in figure.axes[3 * row + 1].collections if isinstance(c, QuadMesh))
        drawn = np.asarray(mesh.get_array()).reshape(-1, 4)
        grid = measured.face.grid(shown[row, :, 1]).ravel()
        pure = colormaps[maps.FIELD](np.clip((grid - low) / (high - low), 0.0, 1.0))
        light = drawn[:, 1] / pure[:, 1]
        assert drawn[:, :3] == pytest.approx(light[:, None] * pure[:, :3], abs=1e-6)
        assert light.min() >= 0.65 - 1e-9 and light.max() <= 1.0 + 1e-9


def test_the_mesh_moves_with_the_motion_as_often_enlarged_as_the_legend_says(
    measured: MeasuredMotion,
) -> None:
    figure = maps.fields(measured)
    text = figure.legends[0].get_texts()[0].get_text()
    assert text == "mesh of u and v, its motion 20 times enlarged"
    for row, image in enumerate(PEAKS):
        for axes in figure.axes[3 * row : 3 * row + 3]:
            (elements,) = polygons(axes)
            moved = measured.nodes_uv + 20.0 * measured.nodal_uv[row]
            assert len(elements) == 12
            assert elements[0][:, ::-1] == pytest.approx(moved[measured.cells_uv[0]])
        assert f"image {image}: end of loading {row + 1}" in figure.axes[3 * row].get_title("left")


def test_a_pixel_is_drawn_where_its_motion_has_taken_it() -> None:
    rows, cols = np.meshgrid([4, 5, 6], [2, 3], indexing="ij")
    face = Face(rows.ravel(), cols.ravel(), 0.1, (5.0, 2.0), np.zeros((0, 2, 2)))
    motion = np.tile([0.03, -0.01], (6, 1))
    corners = maps.moved_corners(face, motion)
    assert corners.shape == (4, 3, 2)
    assert corners[0, 0] == pytest.approx([-0.15 + 0.03, -0.05 - 0.01])
    assert corners[-1, -1] == pytest.approx([0.15 + 0.03, 0.15 - 0.01])


def test_off_the_region_corners_move_with_the_nearest_pixel_and_stay_blank() -> None:
    face = Face(np.array([0, 0, 1]), np.array([0, 1, 1]), 1.0, (0.0, 0.0), np.zeros((0, 2, 2)))
    corners = maps.moved_corners(face, np.tile([0.25, 0.5], (3, 1)))
    assert np.isfinite(corners).all()
    assert corners[2, 0] == pytest.approx([1.75, 0.0])
    assert np.isnan(face.grid(np.ones(3))[1, 0])


@pytest.mark.parametrize(("n_rows", "n_cols"), [(300, 400), (299, 399)])
def test_an_image_of_many_pixels_is_drawn_coarser(
    measured: MeasuredMotion, n_rows: int, n_cols: int
) -> None:
    rows, cols = np.meshgrid(np.arange(n_rows), np.arange(n_cols), indexing="ij")
    face = Face(rows.ravel(), cols.ravel(), PIXEL, (0.0, 0.0), np.zeros((0, 2, 2)))
    heights = np.random.default_rng(1).standard_normal((n_rows, n_cols))
    motion = np.zeros((len(PEAKS), rows.size, 3))
    motion[..., 0] = rows.ravel() / 1e4
    large = replace(measured, face=face, reference=heights, motion=motion)
    mesh = next(c for c in maps.fields(large).axes[0].collections if isinstance(c, QuadMesh))
    assert np.asarray(mesh.get_array()).shape[:2] == (150, 200)
    assert np.asarray(mesh.get_coordinates()).shape[:2] == (151, 201)


def test_a_component_that_does_not_move_has_a_scale_around_it() -> None:
    assert maps.field_limits(np.zeros(9)) == (-1.0, 1.0)


def test_light_falls_with_depth_and_never_below_its_floor() -> None:
    light = maps.relief(np.array([[-50.0, 0.0, 50.0, np.nan]]), 0.0, 20.0)[0, :, 0]
    assert light[:3] == pytest.approx([0.65, 0.65, 1.0])


def test_residuals_stand_in_nanometres_and_grey_levels_and_in_sigma(
    measured: MeasuredMotion,
) -> None:
    figure = maps.residuals(measured)
    for row, image in enumerate(PEAKS):
        metric, over = figure.axes[2 * row : 2 * row + 2]
        assert metric.images[0].get_clim() == pytest.approx((-36.0, 36.0))
        assert over.images[0].get_clim() == (-4.0, 4.0)
        drawn = np.asarray(metric.images[0].get_array())
        assert drawn == pytest.approx(1e3 * measured.face.grid(measured.residual[row]))
        drawn = np.asarray(over.images[0].get_array())
        assert drawn == pytest.approx(measured.face.grid(measured.standardised[row]))
        assert over.get_title("left") == f"image {image}: χ = {measured.chi[image]:.3f}"
    (nm,) = bars(figure, "ρ [nm]")
    figure.canvas.draw()
    levels = nm.child_axes[0]
    assert levels.get_ylabel() == "ρ [grey levels]"
    assert np.array(levels.get_ylim()) * 6.5 == pytest.approx(nm.get_ylim())
