from __future__ import annotations

import meshio
import numpy as np
import pytest

from driver.export.command import export_case
from driver.export.surface import aligned, pixel_squares
from tests.driver.export.exported import (
    COLS,
    FORCE,
    PIXEL,
    ROWS,
    SHIFT,
    TIME,
    XY,
    Results,
    coarse_mesh,
)


def test_the_series_holds_every_image_at_its_time_with_all_fields(results: Results) -> None:
    export_case(results.case_path, results.to, volume=False)
    frames = results.frames()
    assert [time for time, _ in frames] == TIME.tolist()
    for t, (_, mesh) in enumerate(frames):
        assert mesh.points == pytest.approx(np.column_stack([XY, np.zeros(7)]))
        fields = mesh.point_data
        assert fields["motion_model_um"] == pytest.approx(results.motion["final"][t], abs=1e-9)
        assert fields["motion_extended_um"] == pytest.approx(results.motion["after"][t], abs=1e-9)
        assert fields["residual_model_nm"] == pytest.approx(1e3 * results.rho["final"][t])
        assert fields["residual_extended_nm"] == pytest.approx(1e3 * results.rho["after"][t])
        assert fields["height_um"] == pytest.approx(results.reference[ROWS, COLS])


def test_the_shift_of_the_stage_is_taken_off_the_measured_motion_and_kept(results: Results) -> None:
    export_case(results.case_path, results.to)
    for _, mesh in results.frames():
        motion = mesh.point_data
        assert motion["motion_measured_um"] == pytest.approx(motion["motion_model_um"], abs=1e-8)
    for i, axis in enumerate("XYZ"):
        column = results.numbers("images.csv", f"shift_{axis}_nm")
        assert column == pytest.approx(1e3 * SHIFT[:, i], abs=1e-6)


def test_rotations_are_taken_off_in_the_rigid_gauge_alone(results: Results) -> None:
    x, y = (XY - XY.mean(axis=0)).T
    results.measured[1] += np.column_stack([-2e-3 * y, 2e-3 * x, 5e-3 * x - 4e-3 * y])
    results.write_measure()
    export_case(results.case_path, results.to)
    shown = results.frames()[1][1].point_data
    left = np.abs(shown["motion_measured_um"] - shown["motion_model_um"]).max()
    assert left > 2e-4
    expected = {"slope_vX_urad": 2000.0, "slope_wX_urad": 5000.0, "slope_wY_urad": -4000.0}
    for name, slope in expected.items():
        assert results.numbers("images.csv", name)[1] == pytest.approx(slope)
    results.edit('gauge = "translation"', 'gauge = "rigid"')
    results.record("mesh", "measure", "identify", "diagnose")
    export_case(results.case_path, results.to)
    shown = results.frames()[1][1].point_data
    assert shown["motion_measured_um"] == pytest.approx(shown["motion_model_um"], abs=1e-8)


def test_what_is_removed_is_rigid_and_nothing_of_a_stretch_is() -> None:
    motion = np.zeros((1, 7, 3))
    motion[0, :, 1] = XY[:, 1] - XY[:, 1].mean()
    kept, _ = aligned(motion, np.zeros_like(motion), XY, rigid=False)
    assert kept == pytest.approx(motion, abs=1e-15)


def test_squares_face_the_viewer_and_leave_masked_pixels_out() -> None:
    squares = pixel_squares(ROWS, COLS)
    assert len(squares) == 2  # two of the four squares of the field touch a masked pixel
    for square in squares:
        x, y = XY[square].T
        area = 0.5 * (x @ np.roll(y, -1) - y @ np.roll(x, -1))
        assert area == pytest.approx(PIXEL**2)


def test_the_volume_mesh_keeps_its_grains_though_its_picture_was_cut(results: Results) -> None:
    whole = (results.folder / "mesh.vtu").read_bytes()
    (results.folder / "mesh.vtu").write_bytes(whole[:100])
    export_case(results.case_path, results.to)
    mesh = meshio.read(results.to / "mesh.vtu")
    (cells,) = mesh.cells
    assert cells.type == "hexahedron20" and len(cells.data) == len(coarse_mesh().cells)
    assert mesh.cell_data["grain"][0].tolist() == (coarse_mesh().grain + 1).tolist()


@pytest.mark.parametrize("label", ["model", "extended"])
def test_model_and_residual_make_up_the_measured_load(results: Results, label: str) -> None:
    export_case(results.case_path, results.to)
    made_up = results.numbers("loads.csv", f"load_{label}_uN")
    made_up = made_up + results.numbers("loads.csv", f"residual_{label}_uN")
    assert made_up == pytest.approx(results.numbers("loads.csv", "load_measured_uN"))
    assert results.numbers("loads.csv", "load_measured_uN") == pytest.approx(FORCE)
    assert results.numbers("loads.csv", "time_s") == pytest.approx(TIME)


def test_knots_stand_at_the_turning_points_in_nanometres(results: Results) -> None:
    export_case(results.case_path, results.to)
    assert results.numbers("knots.csv", "stage_um").tolist() == [0.0, 10.0, 4.0]
    assert results.numbers("knots.csv", "elongation_model_nm") == pytest.approx([0, 64, 56])
    assert results.numbers("knots.csv", "elongation_extended_nm") == pytest.approx([0, 65, 57])
    rows = results.table("knots.csv")
    assert [row["elongation_model_sigma_nm"] for row in rows] == ["", "1", "2"]
    # Tilt knots are not free here: they have a value and no standard deviation.
    assert [(row["tilt_model_nm"], row["tilt_model_sigma_nm"]) for row in rows] == [("0", "")] * 3


def test_parameters_of_both_models_stand_side_by_side(results: Results) -> None:
    export_case(results.case_path, results.to)
    columns = ("parameter", "unit", "start", "model", "model_sigma", "extended", "extended_sigma")
    assert [tuple(row[name] for name in columns) for row in results.table("parameters.csv")] == [
        ("tau0", "MPa", "40", "21", "0.5", "20", "0.4"),
        ("tau0_grain2", "", "", "", "", "1.15", "0.02"),
        ("tilt_drift", "", "", "", "", "0.001", "0.0001"),
    ]


def test_the_readme_names_every_file_field_and_column_group(results: Results) -> None:
    export_case(results.case_path, results.to)
    text = (results.to / "README.txt").read_text("utf-8")
    for path in results.to.iterdir():
        assert path.name == "README.txt" or path.name in text
    for field in results.frames()[0][1].point_data:
        assert field in text
