import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle

from driver.report import figures, maps
from driver.report.style import png
from meshes.arrays import FloatArray, IntArray
from meshes.cells import EDGES
from meshes.grain_boundary import GrainBoundary
from meshes.prism import PrismGeometry, generate

T = 9
STAGE = np.r_[np.linspace(0, 40, 5), np.linspace(30, 0, 4)]
TIME = np.arange(T, dtype=float) * 40.0


def texts(axes: Axes) -> list[str]:
    return [text.get_text() for text in axes.texts]


def test_the_budget_writes_every_chi_above_its_bar() -> None:
    before = {"model": 1.31, "basis": 1.6, "load": 58.0}
    after = {"model": 1.02, "basis": 1.03, "load": 0.98}
    pixels, mesh, loads = figures.budget(1.01, {"before": before, "after": after}).axes
    assert texts(pixels) == ["1.00", "1.01", "1.31", "1.02"]
    assert texts(mesh) == ["1.00", "1.60", "1.03"]
    assert texts(loads) == ["1.00", "58.0", "0.98"]
    assert all(axes.get_ylim()[0] == 0.0 for axes in (pixels, mesh, loads))
    # The line of noise does not strike out what stands just below it.
    for text in loads.texts:
        box = text.get_bbox_patch()
        assert box is not None and box.get_facecolor() == (1.0, 1.0, 1.0, 1.0)
    assert (pixels.get_ylabel(), loads.get_ylabel()) == ("χ [1]", r"$\mathregular{χ_F}$ [1]")


def test_motion_is_drawn_in_nanometres_over_stage_travel() -> None:
    measured = np.column_stack([STAGE * 1e-3, STAGE * 2e-4])
    identified = {"before": measured * 0.9, "after": measured}
    figure = figures.motion(
        STAGE, np.ones(T, int), measured, np.array([0.02, 0.001]), STAGE, identified,
        np.array([0, 4, 8]),
    )  # fmt: skip
    elongation, tilt = figure.axes
    assert elongation.get_ylabel() == "elongation [nm]" and tilt.get_ylabel() == "tilt [nm]"
    assert elongation.get_xlabel() == "stage travel [µm]"
    knots = next(line for line in elongation.lines if line.get_label() == "knots")
    assert np.allclose(knots.get_xydata(), [[0, 0], [40, 40], [0, 0]])
    band = np.concatenate(
        [np.asarray(c.get_paths()[0].vertices)[:, 1] for c in elongation.collections]
    )
    assert band.min() == pytest.approx(-20.0) and band.max() == pytest.approx(60.0)


def test_the_residual_of_the_load_is_measured_minus_model_with_the_noise_as_a_band() -> None:
    measured = 20.0 * STAGE
    figure = figures.loads(STAGE, TIME, measured, {"before": measured - 7.0}, 5.97, 2 * measured)
    loop, residual = figure.axes
    line = next(line for line in residual.lines if line.get_label() == "identified model")
    assert np.allclose(line.get_ydata(), 7.0)
    band = residual.patches[0]
    assert isinstance(band, Rectangle)
    assert band.get_height() == pytest.approx(2 * 5.97)
    initial = next(line for line in loop.lines if line.get_label() == "at the start")
    assert np.array_equal(initial.get_ydata(), 2 * measured)
    assert loop.get_ylabel() == "load on the specimen [µN]"
    assert residual.get_ylabel() == "measured − model [µN]"


def face() -> maps.Face:
    rows, cols = np.meshgrid(np.arange(3, 23), np.arange(5, 65), indexing="ij")
    return maps.Face(
        rows.ravel(), cols.ravel(), 0.1, (12.5, 4.5), np.array([[[-1, 2.0], [1, 3.0]]])
    )


def test_residuals_over_strain_are_in_units_of_noise_and_a_curve_for_each_cycle() -> None:
    strain, cycle = 1e-3 * np.arange(6.0), np.array([1, 1, 1, 2, 2, 2])
    sides = {"before": np.arange(6.0), "after": np.zeros(6)}
    load, images = figures.residual_over_strain(strain, cycle, sides, sides).axes
    assert load.get_xlabel() == "strain [%]" and images.get_ylabel() == "rms of ρ/σ [1]"
    first, second = load.lines[:2]
    np.testing.assert_allclose(np.asarray(first.get_xdata(), dtype=np.float64), [0.0, 0.1, 0.2])
    np.testing.assert_allclose(np.asarray(second.get_ydata(), dtype=np.float64), [3.0, 4.0, 5.0])
    assert [line.get_label() for line in images.lines[:2]] == [
        "model before, cycle 1", "model before, cycle 2",
    ]  # fmt: skip


def test_maps_are_in_micrometres_with_y_to_the_right_and_x_down() -> None:
    seen = face()
    values = seen.rows.astype(float)
    figure = maps.residual_maps(seen, ["peak"], {"before": values[None]}, {"before": values})
    axes = figure.axes[0]
    left, right, bottom, top = axes.images[0].get_extent()
    assert (left, right) == pytest.approx((0.0, 6.0))
    assert (bottom, top) == pytest.approx((1.0, -1.0))
    assert axes.images[0].get_clim() == (-4.0, 4.0)
    shown = axes.images[0].get_array()
    assert shown is not None
    assert np.all(shown[0] == 3.0) and np.all(shown[-1] == 22.0)


def test_pixels_off_the_region_stay_blank() -> None:
    rows, cols = np.array([0, 0, 1]), np.array([0, 1, 1])
    image = maps.Face(rows, cols, 0.1, (0.0, 0.0), np.zeros((0, 2, 2))).grid(
        np.array([1.0, 2.0, 3.0])
    )
    assert np.array_equal(image, [[1.0, 2.0], [np.nan, 3.0]], equal_nan=True)


def test_displacements_and_their_difference_share_one_scale_and_are_in_nanometres() -> None:
    seen = face()
    motion = np.zeros((seen.rows.size, 3))
    motion[:, 1] = 0.1 * np.linspace(-1.0, 1.0, seen.rows.size) + 5.0
    figure = maps.fields(seen, {"free correlation": motion, "model": 0.5 * motion})
    limits = [axes.images[0].get_clim() for axes in figure.axes if axes.images]
    v = [limit for limit in limits if limit[1] > 90.0]
    assert len(v) == 3 and len(set(v)) == 1 and v[0][0] == -v[0][1]
    maps_of_v = [axes.images[0].get_array() for axes in figure.axes[1:9:3] if axes.images]
    assert np.ptp(np.ma.asarray(maps_of_v[2])) == pytest.approx(100.0)  # half of 200 nm
    assert "v − mean [nm]" in [axes.get_xlabel() for axes in figure.axes]


def two_tetrahedra() -> tuple[FloatArray, IntArray]:
    """Two tetrahedra that share the face x + y + z = 1, each a grain of its own."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1.0]])
    cells = np.array([[0, 1, 2, 3], [1, 2, 3, 4]])
    pairs = np.sort(cells[:, EDGES[10]].reshape(-1, 2), axis=1)
    unique, place = np.unique(pairs, axis=0, return_inverse=True)
    middle = len(corners) + place.reshape(2, 6)
    points = np.concatenate([corners, corners[unique].mean(axis=1)])
    return points, np.concatenate([cells, middle], axis=1)


def test_only_outer_faces_towards_the_viewer_are_drawn() -> None:
    points, cells = two_tetrahedra()
    for height, expected in (
        (-1.0, {(0, 1, 2): 0, (1, 2, 4): 1}),
        (1.0, {(1, 3, 4): 1, (2, 3, 4): 1}),
    ):
        faces, owner = maps.visible_faces(points, cells, np.array([0.0, 0.0, height]))
        corners = [tuple(sorted(corner.tolist())) for corner in faces]
        assert dict(zip(corners, owner.tolist(), strict=True)) == expected


def test_the_grain_boundary_is_where_faces_of_two_grains_meet() -> None:
    faces = np.array([[0, 1, 2], [1, 3, 2], [1, 4, 3]])
    assert maps.boundary_edges(faces, np.array([0, 1, 1])).tolist() == [[1, 2]]
    assert maps.boundary_edges(faces, np.zeros(3, int)).size == 0


def test_hexahedra_are_drawn_by_their_quadrilaterals() -> None:
    """Seen along −Z: the face, two cells to a layer; along Y the end with three quadrilaterals."""
    geometry = PrismGeometry(boundaries=(GrainBoundary((0, 5.4, 0), (0.15, 1, 0.30)),))
    mesh = generate(geometry, 3.0, "hex20", (2, 3))
    for towards, group in (((0.0, 0.0, 1.0), "TOP"), ((0.0, 1.0, 0.0), "S_PLUS")):
        faces, owner = maps.visible_faces(mesh.points, mesh.cells, np.array(towards))
        np.testing.assert_array_equal(
            np.sort(faces, axis=0), np.sort(mesh.faces[group][:, :4], axis=0)
        )
        for face, cell in zip(faces, owner, strict=True):
            assert set(face) <= set(mesh.cells[cell, :8])
    faces, owner = maps.visible_faces(mesh.points, mesh.cells, np.array([0.0, 0.0, 1.0]))
    trace = maps.boundary_edges(faces, mesh.grain[owner])
    # 5.4 − 0.15 X on the face, from X = −2 over 0 to 2.
    ends = np.sort(mesh.points[trace].reshape(-1, 3)[:, 1])
    np.testing.assert_allclose(ends, [5.1, 5.4, 5.4, 5.7])
    figure = maps.specimen(mesh.points, mesh.cells, mesh.grain, ("A", "B"))
    drawn = figure.axes[0].collections[0].get_paths()
    assert {np.shape(path.vertices) for path in drawn} == {(5, 2)}  # closed


def test_a_figure_becomes_a_png_file() -> None:
    side = {"model": 1.0, "basis": 1.0, "load": 1.0}
    assert png(figures.budget(1.0, {"before": side})).startswith(b"\x89PNG")
