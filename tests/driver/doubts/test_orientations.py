"""What a check tells of orientations, and asks about."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from driver.case.grains import Grain, Orientation
from driver.case.model import Case, default_case, load_case, write_case
from driver.doubts.orientations import look_at_orientations
from tests.driver.ebsd_files import FIRST, SECOND, grid, halves, write_ang, write_ctf
from tests.driver.experiment.test_map_labels import case_in as map_case
from tests.driver.experiment.test_map_labels import picked_at, write_map

X, Y = grid(4, 6)
ROWS = ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0))
ANGLES = Grain(name="first", euler_deg=FIRST)


def case_of(folder: Path, *grains: Grain, **orientation: object) -> Case:
    update = {"grains": grains, "orientation": Orientation.model_validate(orientation)}
    write_case(default_case().model_copy(update=update), folder / "case.toml")
    return load_case(folder / "case.toml")


def told(case: Case, level: str) -> list[str]:
    found = look_at_orientations(case)
    assert all(finding.subject == "orientation" for finding in found)
    return [finding.message for finding in found if finding.level == level]


def of_second(folder: Path, angles: tuple[float, float, float]) -> list[str]:
    return told(case_of(folder, ANGLES, Grain(name="second", euler_deg=angles)), "warning")


def test_usual_angles_are_told_by_the_crystal_along_the_loading_axis(tmp_path: Path) -> None:
    case = case_of(tmp_path, ANGLES, Grain(name="second", euler_deg=(0.0, 0.0, 0.0)))
    assert told(case, "warning") == told(case, "error") == []
    assert told(case, "ok")[1] == "second: loading axis along crystal [+0.000 +1.000 +0.000]"


@pytest.mark.parametrize(
    ("angles", "same"),
    [
        ((10.0, 200.0, 30.0), "[190.0, 160.0, 210.0]"),
        ((10.0, -20.0, 30.0), "[190.0, 20.0, 210.0]"),
        ((370.0, 20.0, 30.0), "[10.0, 20.0, 30.0]"),
    ],
)
def test_angles_beyond_their_range_are_told_with_their_equivalent(
    tmp_path: Path, angles: tuple[float, float, float], same: str
) -> None:
    assert of_second(tmp_path, angles) == [
        f"grains.2.euler_deg = {list(angles)} is beyond its range (φ1 and φ2 to 360, Φ from 0 to "
        f"180) and is taken as {same}, the same rotation"
    ]
    assert of_second(tmp_path, (-79.0, 20.0, -313.0)) == []


def test_angles_that_look_like_radians_are_asked_about(tmp_path: Path) -> None:
    (message,) = of_second(tmp_path, (3.6826, 0.7854, 2.618))
    assert message == (
        "grains.2.euler_deg = [3.6826, 0.7854, 2.618] looks like radians and is taken as degrees; "
        "if it is radians, write euler_deg = [210.997, 45.0, 150.0]"
    )
    for degrees in ((0.0, 5.0, 2.0), (0.5, 45.0, 0.5)):
        assert of_second(tmp_path, degrees) == []


def test_grains_of_one_crystal_are_told(tmp_path: Path) -> None:
    # A quarter turn of the crystal about its own z, and 0.3° more.
    (message,) = of_second(tmp_path, (281.0, 8.0, 137.3))
    assert message.startswith(
        "grains: first and second are the same crystal within 0.5° (0.30°, symmetry considered)"
    )
    assert of_second(tmp_path, (281.0, 8.0, 137.6)) == []


def test_a_map_is_told_with_its_grain_its_spread_and_the_prior(tmp_path: Path) -> None:
    turned = np.array(FIRST) + np.outer(np.where(np.arange(24) % 2, 1.0, -1.0), [1.0, 0, 0])
    write_ctf(tmp_path / "a.ctf", X, Y, turned, np.where(X > 1.9, 0, 1))
    second = Grain(name="second", ebsd="a.ctf", ebsd_point_um=(0.6, 0.4))
    orientation = {"ebsd_frame": "oxford", "ebsd_to_specimen": ROWS}
    case = case_of(tmp_path, Grain(name="first", euler_deg=SECOND), second, **orientation)
    assert told(case, "warning") == told(case, "error") == []
    frame, _, _, of_map = told(case, "ok")
    assert frame == (
        'Euler angles of "oxford"; of the map x is along +Y, y along +X and z, into its surface, '
        "along −Z of the specimen"
    )
    assert of_map == (
        "second: the grain at [0.5, 0.5] µm, whose neighbours differ by less than 5°, in "
        f"{tmp_path / 'a.ctf'} (16 of 24 points indexed): 16 points, mean φ1, Φ, φ2 = 281.00, "
        "8.00, 47.00°, spread 1.00° rms; a turn about an axis has a prior of 2°"
    )


def test_a_grain_by_its_number_is_told_by_it(tmp_path: Path) -> None:
    write_ang(tmp_path / "a.ang", X, Y, halves(X, 1.2), grains=np.where(X < 1.2, 7, 8))
    case = case_of(tmp_path, ANGLES, Grain(name="second", ebsd="a.ang", ebsd_grain=8))
    assert any("second: grain 8 of the file in" in message for message in told(case, "ok"))


def test_what_a_map_leaves_in_doubt_is_asked_about(tmp_path: Path) -> None:
    few = np.where(((X == 1.0) & (Y == 1.0))[:, None], SECOND, FIRST)
    write_ctf(tmp_path / "a.ctf", X, Y, few, header={"AcqE2": "-90.0000"})
    second = Grain(name="second", ebsd="a.ctf", ebsd_point_um=(1.0, 1.0))
    place = f"{tmp_path / 'a.ctf'}: grains.2.ebsd: "
    frame, lone, surface = told(case_of(tmp_path, ANGLES, second), "warning")
    assert frame.startswith("orientation.ebsd_frame: found nothing, so that x and y of the map are")
    assert 'expected "edax", "oxford" or "bruker"' in frame
    assert lone == (
        f"{place}found a grain of 1 point(s), expected one of 10 or more: it may be indexed wrongly"
    )
    assert surface.startswith(
        f"{place}the map was acquired on a surface turned by AcqE1 to AcqE3 = 0, -90, 0°"
    )
    write_ctf(tmp_path / "a.ctf", X, Y, np.deg2rad(FIRST))
    (radians,) = told(case_of(tmp_path, ANGLES, second, ebsd_frame="oxford",
                              ebsd_to_specimen=ROWS), "warning")  # fmt: skip
    assert radians.startswith(f"{place}all Euler angles of the map look like radians")


def test_a_map_seen_from_behind_the_face_is_asked_about(tmp_path: Path) -> None:
    write_ctf(tmp_path / "a.ctf", X, Y, SECOND)
    second = Grain(name="second", ebsd="a.ctf", ebsd_point_um=(1.0, 1.0))
    (message,) = told(case_of(tmp_path, ANGLES, second, ebsd_frame="bruker"), "warning")
    assert message.startswith("orientation.ebsd_to_specimen: found z of the map, which points into")


def test_a_map_that_cannot_be_used_is_one_error(tmp_path: Path) -> None:
    case = case_of(tmp_path, ANGLES, Grain(name="second", ebsd="a.ctf", ebsd_point_um=(1, 1)))
    found = look_at_orientations(case)
    assert [(one.level, one.message) for one in found] == [
        ("error", f"{tmp_path / 'a.ctf'}: grains.2.ebsd: found nothing, expected an EBSD map in a "
                  "file .ang, .ctf or .h5"),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("matrix", "exchanged", "warned"),
    [
        (ROWS, False, False),
        (ROWS, True, True),
        # x of the map along −Y, y along −X.
        (((0.0, -1.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 0.0, -1.0)), False, True),
        (((0.0, -1.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 0.0, -1.0)), True, False),
    ],
)
def test_grains_that_the_map_shows_the_other_way_round_are_told(
    tmp_path: Path,
    matrix: tuple[tuple[float, ...], ...],
    exchanged: bool,
    warned: bool,
) -> None:
    write_ang(tmp_path / "a.ang", X, Y, halves(X, 1.2))
    left, right = ((float(X.min()), float(Y.min())), (float(X.max()), float(Y.min())))
    picks = (right, left) if exchanged else (left, right)
    grains = [
        Grain(name=name, ebsd="a.ang", ebsd_point_um=point)
        for name, point in zip(("first", "second"), picks, strict=True)
    ]
    case = case_of(tmp_path, *grains, ebsd_frame="edax", ebsd_to_specimen=matrix)
    (message,) = [m for m in told(case, "warning") if "farther along" in m] or [""]
    assert bool(message) == warned
    if warned:
        assert message.startswith("grains: by orientation.ebsd_to_specimen first lies farther")


@pytest.mark.parametrize(
    ("write", "wrong", "right"),
    [(write_ang, ("oxford", "bruker"), ("edax",)), (write_ctf, ("edax",), ("oxford", "bruker"))],
)
def test_the_frame_of_another_maker_than_wrote_the_map_is_asked_about(
    tmp_path: Path,
    write: Callable[..., Path],
    wrong: Sequence[str],
    right: Sequence[str],
) -> None:
    file = tmp_path / ("map.ang" if write is write_ang else "map.ctf")
    write(file, X, Y, halves(X, 1.5))
    grains = tuple(
        Grain(name=name, ebsd=str(file), ebsd_point_um=(at, 0.5))
        for name, at in (("first", 0.5), ("second", 2.0))
    )

    def warned(frame: str) -> list[str]:
        case = case_of(tmp_path, *grains, ebsd_frame=frame, ebsd_to_specimen=ROWS)
        return [line for line in told(case, "warning") if "another maker's" in line]

    for frame in wrong:
        (line,) = warned(frame)
        assert line.startswith(f'{file}: orientation.ebsd_frame: found "{frame}" for a map with')
        assert f"expected {' or '.join(map(repr, right))},".replace("'", '"') in line
    assert [line for frame in right for line in warned(frame)] == []


def test_a_map_that_another_program_has_handed_on_may_be_of_any_maker(tmp_path: Path) -> None:
    """Orix names its columns so."""
    file = write_ang(tmp_path / "map.ang", X, Y, halves(X, 1.5), grains=np.where(X < 1.5, 1, 2))
    grains = tuple(Grain(name=name, ebsd=str(file), ebsd_grain=n) for n, name in enumerate("ab", 1))
    case = case_of(tmp_path, *grains, ebsd_frame="oxford", ebsd_to_specimen=ROWS)
    assert not any("another maker's" in line for line in told(case, "warning"))


def tilted(folder: Path, normal: tuple[float, float, float], angle: float) -> list[str]:
    """Warnings of a boundary of this normal, where a map of 12 × 8 µm shows its trace in the face.

    Args:
        folder: of the case.
        normal: of the boundary in the case.
        angle: of the trace in the map, from its y towards its x [degrees].
    """
    x, y = grid(33, 49, 0.25)
    slope = np.tan(np.deg2rad(angle))
    turned = np.where((x - 6.0 < slope * (y - 4.0))[:, None], FIRST, SECOND)
    file = write_ang(folder / "map.ang", x, y, turned)
    grains = tuple(
        Grain(name=name, ebsd=str(file), ebsd_point_um=(at, 4.0))
        for name, at in (("first", 3.0), ("second", 9.0))
    )
    case = case_of(folder, *grains, ebsd_frame="edax", ebsd_to_specimen=ROWS)
    plane = {"boundary_point_um": (0.0, 6.0, 0.0), "boundary_normal": normal}
    specimen = case.specimen.model_copy(update=plane)
    return told(case.model_copy(update={"specimen": specimen}), "warning")


@pytest.mark.parametrize("angle", [-20.0, 0.0, 3.0, 30.0])
def test_a_boundary_that_the_map_shows_as_the_case_has_it_is_not_doubted(
    tmp_path: Path, angle: float
) -> None:
    """With x along Y and y along X the trace Y = X tan a has the normal (−sin a, cos a)."""
    a = np.deg2rad(angle)
    assert tilted(tmp_path, (-np.sin(a), np.cos(a), 0.4), angle) == []


def test_a_boundary_that_the_map_shows_otherwise_is_told_with_the_normal_that_it_shows(
    tmp_path: Path,
) -> None:
    a = np.deg2rad(20.0)
    (line,) = tilted(tmp_path, (np.sin(a), np.cos(a), 0.4), 20.0)
    assert line.startswith(
        "specimen.boundary_normal: found a plane whose trace on the face is 40° from that of first "
        f"and second in {tmp_path / 'map.ang'} (± "
    )
    shown = [float(number) for number in line.split("about [")[1].split("]")[0].split(",")]
    unit = np.array([-np.sin(a), np.cos(a), 0.4]) / np.sqrt(1.16)
    np.testing.assert_allclose(shown, unit, atol=0.02)


def test_grains_that_a_map_places_are_asked_for_in_no_order(tmp_path: Path) -> None:
    """Two of them lie side by side, the second after the third along Y."""
    write_map(tmp_path / "map.ang")
    findings = look_at_orientations(picked_at(map_case(tmp_path), 2, (9.0, 1.8)))
    assert not [one.message for one in findings if one.level != "ok"]
