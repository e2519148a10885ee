"""Bunge angles and maps become rotations in one place."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from driver.case.grains import EULER_AXES, EbsdFrame, Grain, Orientation
from driver.case.model import Case, case_text, default_case, load_case, write_case
from driver.experiment import orientations
from driver.experiment.ebsd.maps import EbsdMap, read_map
from driver.experiment.orientations import (
    OrientationError,
    grain_orientations,
    map_files,
    orientations_of,
    rotation_scales,
)
from driver.parameters.microstructure import ROTATION_SCALE
from meshes.arrays import FloatArray
from tests.driver.ebsd_files import FIRST, SECOND, grid, halves, write_ang, write_ctf

ALPHA = Path(__file__).parents[3] / "examples" / "alpha" / "case.toml"
X, Y = grid(4, 6)
# Angles of which an .ang file keeps every digit.
EXACT = (math.degrees(4.90438), math.degrees(0.13963), math.degrees(0.82030))
ROWS = ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0))


def write(tmp_path: Path, *changes: tuple[str, str]) -> Path:
    """The default case with some of its text replaced."""
    text = case_text(default_case())
    for old, new in changes:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    path = tmp_path / "case.toml"
    path.write_text(text, encoding="utf-8")
    return path


def case_of(folder: Path, *grains: Grain, **orientation: object) -> Case:
    update = {"grains": grains, "orientation": Orientation.model_validate(orientation)}
    write_case(default_case().model_copy(update=update), folder / "case.toml")
    return load_case(folder / "case.toml")


def refused(case: Case) -> str:
    with pytest.raises(OrientationError) as error:
        orientations_of(case)
    return str(error.value)


def young_modulus(direction: FloatArray) -> float:
    """Young's modulus [MPa] of the cubic crystal along a direction in crystal axes (Nye 1957)."""
    c11, c12, c44 = 233.5e3, 135.5e3, 118e3
    det = (c11 - c12) * (c11 + 2 * c12)
    s11, s12, s44 = (c11 + c12) / det, -c12 / det, 1 / c44
    l2, m2, n2 = np.asarray(direction) ** 2
    return float(1 / (s11 - 2 * (s11 - s12 - s44 / 2) * (l2 * m2 + m2 * n2 + n2 * l2)))


def test_the_first_grain_is_as_stiff_along_Y_as_in_code_aster() -> None:
    # Code_Aster 15.2, one HEXA8, ANGL_EULER = (281, 8, 47), uniaxial stress along Y, after the
    # first step: stress 109.834484338433 MPa, strain 8.33333333333333e-4, of which
    # 2.79788085082804e-4 plastic.
    modulus = 109.834484338433 / (8.33333333333333e-4 - 2.79788085082804e-4)
    first = orientations_of(load_case(ALPHA))[0]
    assert young_modulus(first[1]) == pytest.approx(modulus, rel=1e-6)
    # The inverse rotation, the usual mistake, is another crystal.
    assert young_modulus(first[:, 1]) != pytest.approx(modulus, rel=1e-3)


def test_the_second_grain_is_as_stiff_along_Z_as_in_a_point_solution() -> None:
    # Backward-Euler point solution that agrees with CalculiX 2.20, Bunge (211, 45, 150),
    # uniaxial stress along Z: 63.764812769 MPa at a strain of 2.5e-4, still elastic.
    second = orientations_of(load_case(ALPHA))[1]
    assert young_modulus(second[2]) == pytest.approx(63.764812769 / 2.5e-4, rel=1e-9)


def test_turning_the_ebsd_frame_back_restores_the_crystals(tmp_path: Path) -> None:
    """A specimen mounted 30° askew: φ1 grows by 30°, the rotation of the frame takes it back."""
    expected = orientations_of(load_case(write(tmp_path)))
    c, s = np.cos(np.radians(30)), np.sin(np.radians(30))
    back = [[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]
    turned = load_case(
        write(
            tmp_path,
            ("[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]", json.dumps(back)),
            ("euler_deg = [30.0, 0.0, 0.0]", "euler_deg = [60.0, 0.0, 0.0]"),
            ("euler_deg = [0.0, 0.0, 0.0]", "euler_deg = [30.0, 0.0, 0.0]"),
        )
    )
    np.testing.assert_allclose(orientations_of(turned), expected, atol=1e-12)


def test_angles_beyond_their_range_are_the_rotation_that_they_make() -> None:
    beyond = default_case().model_copy(
        update={
            "grains": (
                Grain(name="a", euler_deg=(10.0, 200.0, 30.0)),
                Grain(name="b", euler_deg=(190.0, 160.0, 210.0)),
            )
        }
    )
    first, second = orientations_of(beyond)
    np.testing.assert_allclose(first, second, atol=1e-15)


@pytest.mark.parametrize("frame", [None, *EULER_AXES])
def test_a_map_of_one_orientation_is_that_of_its_angles(
    tmp_path: Path, frame: EbsdFrame | None
) -> None:
    write_ang(tmp_path / "a.ang", X, Y, EXACT)
    write_ctf(tmp_path / "a.ctf", X, Y, FIRST)
    stated = {"ebsd_frame": frame, "ebsd_to_specimen": ROWS}
    mapped = case_of(
        tmp_path,
        Grain(name="a", ebsd="a.ang", ebsd_point_um=(1.0, 1.0)),
        Grain(name="b", ebsd="a.ctf", ebsd_point_um=(0.0, 0.0)),
        **stated,
    )
    angles = case_of(
        tmp_path, Grain(name="a", euler_deg=EXACT), Grain(name="b", euler_deg=FIRST), **stated
    )
    found = orientations_of(mapped)
    np.testing.assert_allclose(found, orientations_of(angles), atol=1e-6)
    # By scipy alone: Q · V · Rz(φ1) · Rx(Φ) · Rz(φ2).
    frames = np.array(ROWS) @ (np.eye(3) if frame is None else np.array(EULER_AXES[frame]))
    expected = frames @ Rotation.from_euler("ZXZ", [EXACT, FIRST], degrees=True).as_matrix()
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_both_grains_of_a_map_are_told_with_their_angles(tmp_path: Path) -> None:
    write_ctf(tmp_path / "a.ctf", X, Y, halves(X, 1.2))
    picks = {"a": (0.0, 0.0), "b": (2.0, 0.5)}
    case = case_of(
        tmp_path,
        *(Grain(name=name, ebsd="a.ctf", ebsd_point_um=place) for name, place in picks.items()),
    )
    assert map_files(case) == (tmp_path / "a.ctf",)
    for grain, angles in zip(grain_orientations(case), (FIRST, SECOND), strict=True):
        np.testing.assert_allclose(np.mod(grain.euler_deg, 360.0), angles, atol=1e-9)
        assert grain.of_map is not None and grain.of_map.points == 12


def test_a_map_is_read_once_until_it_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read: list[Path] = []

    def counted(file: Path) -> EbsdMap:
        read.append(file)
        return read_map(file)

    monkeypatch.setattr(orientations, "read_map", counted)
    file = write_ctf(tmp_path / "a.ctf", X, Y, FIRST)
    two = (Grain(name=name, ebsd="a.ctf", ebsd_point_um=(0.0, 0.0)) for name in "ab")
    case = case_of(tmp_path, *two)
    before = orientations_of(case)
    orientations_of(case)
    assert len(read) == 1
    write_ctf(file, X, Y, SECOND)
    os.utime(file, ns=(1, 1))
    assert np.abs(orientations_of(case) - before).max() > 0.1 and len(read) == 2


def test_a_map_that_cannot_be_used_is_told_with_its_file_and_key(tmp_path: Path) -> None:
    write_ctf(tmp_path / "a.ctf", X, Y, FIRST)
    angles = Grain(name="a", euler_deg=FIRST)
    for name, pick, said in (
        ("b.ctf", (0.0, 0.0), "found nothing, expected an EBSD map in a file .ang, .ctf or .h5"),
        ("a.ctf", None, "found no grain that is picked, expected ebsd_point_um = [x, y] with x"),
        ("a.ctf", (9.0, 0.0), "found ebsd_point_um = [9, 0], where it has no point, expected"),
    ):
        message = refused(case_of(tmp_path, angles, Grain(name="b", ebsd=name, ebsd_point_um=pick)))
        assert message.startswith(f"{tmp_path / name}: grains.2.ebsd: {said}")
        assert "\n" not in message


def test_a_spread_above_the_usual_scale_is_the_prior_of_the_turns_of_its_grain(
    tmp_path: Path,
) -> None:
    def spread(degrees: float) -> FloatArray:
        turns = np.deg2rad(degrees) * np.where(np.arange(X.size) % 2, 1.0, -1.0)
        turned = Rotation.from_rotvec(np.outer(turns, [0, 0, 1]))
        both = turned * Rotation.from_euler("ZXZ", FIRST, degrees=True)
        return np.asarray(both.as_euler("ZXZ", degrees=True))

    # The points of either sign are at ±2.4° and at ±4.5° of a chain of 0.9° steps.
    write_ctf(tmp_path / "little.ctf", X, Y, spread(2.4))
    along = np.array(FIRST) + np.outer(X / 0.5 - 2.5, [4.5, 0.0, 0.0])
    write_ctf(tmp_path / "much.ctf", X, Y, along)
    picks = [
        Grain(name=name, ebsd=f"{name}.ctf", ebsd_point_um=(0.0, 0.0))
        for name in ("little", "much")
    ]
    scales = rotation_scales(case_of(tmp_path, *picks))
    # Turns about Z of −11.25° to 11.25° in steps of 4.5°.
    rms = np.deg2rad(4.5) * np.sqrt(np.mean((np.arange(6) - 2.5) ** 2))
    assert set(scales) == {f"rotation_grain2_{axis}" for axis in "xyz"}
    np.testing.assert_allclose(list(scales.values()), rms / np.sqrt(3), rtol=1e-6)
    assert min(scales.values()) > ROTATION_SCALE == np.deg2rad(2)
    assert rotation_scales(default_case()) == {}
