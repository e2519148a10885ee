from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from driver.case.grains import EULER_AXES, EbsdFrame, Grain, Orientation
from driver.case.model import case_text, default_case, load_case
from meshes.arrays import FloatArray
from tests.driver.case.tables import refused

ANGLES = (281.0, 8.0, 47.0)


def test_a_rounded_rotation_is_made_a_proper_one() -> None:
    rounded = ((0.8660, -0.5000, 0.0), (0.5000, 0.8660, 0.0), (0.0, 0.0, 1.0))
    rotation = Orientation(ebsd_to_specimen=rounded).rotation
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(rotation[0], [3**0.5 / 2, -0.5, 0], atol=1e-4)


def test_what_is_no_rotation_to_a_thousandth_or_mirrors_is_refused() -> None:
    near, far, mirror = (
        ((1.0, slope, 0.0), (-slope, 1.0, 0.0), (0.0, 0.0, last))
        for slope, last in ((3e-4, 1.0), (4e-2, 1.0), (0.0, -1.0))
    )
    assert np.linalg.det(Orientation(ebsd_to_specimen=near).rotation) == pytest.approx(1.0)
    assert "orthonormal rows" in refused(Orientation, ebsd_to_specimen=far)[1]
    assert "mirrors the crystal" in refused(Orientation, ebsd_to_specimen=mirror)[1]


# Axes of the Euler angles in the map, x right, y down and z into the specimen, as panels c of the
# figures in "Reference frames" of kikuchipy draw them.
DRAWN = {
    "edax": ("-y", "-x", "-z"),  # RD, TD, ND
    "oxford": ("-x", "+y", "-z"),  # X1, Y1, Z1
    "bruker": ("-x", "+y", "-z"),  # X_euler, Y_euler, Z_euler
}


def axis(name: str) -> FloatArray:
    return np.asarray(float(f"{name[0]}1") * np.eye(3)["xyz".index(name[1])])


@pytest.mark.parametrize("frame", EULER_AXES)
def test_euler_axes_are_those_that_kikuchipy_draws(frame: EbsdFrame) -> None:
    orientation = Orientation(ebsd_frame=frame)
    drawn = np.column_stack([axis(name) for name in DRAWN[frame]])
    np.testing.assert_array_equal(orientation.from_euler_axes, drawn)
    assert np.linalg.det(drawn) == pytest.approx(1.0)


def test_those_of_edax_are_setting_2_of_mtex() -> None:
    # rotation.byAxisAngle(xvector-yvector,180*degree) in interfaces/loadEBSD_ang.m: 2 a aᵀ − 1.
    a = np.array([1.0, -1.0, 0.0]) / np.sqrt(2)
    setting_2 = 2 * np.outer(a, a) - np.eye(3)
    found = Orientation(ebsd_frame="edax").from_euler_axes
    np.testing.assert_allclose(found, setting_2, atol=1e-15)


def test_those_of_oxford_are_a_quarter_turn_about_the_normal_from_those_of_edax() -> None:
    # EMsoft issue 155: 90° more of φ1 from Oxford to EDAX, that is Rz(90°) on the left.
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    edax, oxford = (Orientation(ebsd_frame=one).from_euler_axes for one in ("edax", "oxford"))
    np.testing.assert_allclose(edax @ quarter, oxford, atol=1e-15)


def test_the_frame_of_the_map_comes_before_the_rotation_to_the_specimen() -> None:
    rows = ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0))
    both = Orientation(ebsd_frame="edax", ebsd_to_specimen=rows).from_euler_axes
    # A1 of EDAX is up in the map, −y, and y of the map is +X here; A3 is out of the face.
    np.testing.assert_array_equal(both, [[-1, 0, 0], [0, -1, 0], [0, 0, 1]])
    plain = Orientation(ebsd_to_specimen=rows).from_euler_axes
    np.testing.assert_allclose(plain, rows, atol=1e-15)


def test_a_grain_has_angles_or_a_map() -> None:
    key, expected = refused(Grain, name="a")
    assert key == "euler_deg" and expected.endswith("Bunge angles in degrees, or a map, ebsd")
    both = refused(Grain, name="a", euler_deg=ANGLES, ebsd="a.ang")
    assert both == ("ebsd", "one of euler_deg and ebsd")


def test_a_pick_needs_a_map_and_is_one() -> None:
    for stated in ({"ebsd_point_um": (1.0, 2.0)}, {"ebsd_grain": 3}):
        without = refused(Grain, name="a", euler_deg=ANGLES, **stated)
        assert without == (next(iter(stated)), "an EBSD map as well, ebsd")
    both = refused(Grain, name="a", ebsd="a.ang", ebsd_point_um=(1.0, 2.0), ebsd_grain=3)
    assert both == ("ebsd_grain", "one of ebsd_point_um and ebsd_grain")
    assert refused(Grain, name="a", ebsd="a.ang", ebsd_grain=1.5)[0] == "ebsd_grain"


def test_keys_that_are_left_out_leave_the_tables_as_they_were_before_there_were_any() -> None:
    # Stages are done again where the hash of these tables changes.
    written = default_case().model_dump(mode="json")
    assert written["grains"][0] == {"name": "grain 1", "euler_deg": [0.0, 0.0, 0.0]}
    assert list(written["orientation"]) == ["ebsd_to_specimen"]


def test_a_written_case_has_its_maps(tmp_path: Path) -> None:
    grains = (
        Grain(name="a", ebsd="map.ang", ebsd_point_um=(12.0, 8.5)),
        Grain(name="b", ebsd="map.ctf", ebsd_grain=3),
    )
    update = {"grains": grains, "orientation": Orientation(ebsd_frame="oxford")}
    case = default_case().model_copy(update=update)
    path = tmp_path / "case.toml"
    path.write_text(case_text(case), encoding="utf-8")
    read = load_case(path)
    assert (read.grains, read.orientation) == (case.grains, case.orientation)
